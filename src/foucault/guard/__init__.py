"""What people do wrong with a log: each mistake has an undoing, and a guard tries them one by one.

`mistakes` lists them and asks which of them explains a log; the others say what is compared:
`turns` gyros with accelerometers between rests, `rest` readings at rest with gravity and the
Earth's rate, `table` with a table, `command` with a command, `master` with a master, `north` the
Earth's rate with a latitude. What each procedure can see is in `docs/guard.toml`.
"""
