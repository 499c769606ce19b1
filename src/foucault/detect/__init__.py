"""Where a log rests, turns steadily and moves: one segmentation, fed to every procedure.

`stretches` says which windows of a log are quiet and belong together; `live` says it of a log that
grows, `cells` and `table` of one on disk, taken on a table. `sequence`, `faces` and `spins` say
what lies between, `dwells` does so by the index angle of a north seeker. `spikes` are set apart
before, `noise` and `means` are measured after; `match` compares with what was planned.
"""
