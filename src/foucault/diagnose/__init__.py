"""What log, plan or estimate say of themselves. Nothing here changes an estimate.

A file has the name of what is judged: its checks, which make the verdict, and its tables and
findings, which a report shows.
"""
