"""What a rig or a vehicle is to do, and the search for what shows the coefficients best.

Files here hold for any motion. In the folders `search` is the space of a search by `optimise`,
`moves` what it may change, `reach` what the rig can do.
"""
