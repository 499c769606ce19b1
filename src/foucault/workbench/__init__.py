"""The workbench: pages in a browser over everything, from a log that is dropped to its verdict.

A job is a command line. A page asks for one (`asked`), the queue keeps it (`store`), a worker runs
the program itself with it in the folder of the workbench (`worker`), and the page shows what that
left (`pages`, `views`). So a page can do what the command line can, says how, and finds the same.

Everything lies in one folder::

    logs/4f0c.../log.csv      what was sent in, by the hash of its names and content
    runs/12/                  what job 12 has written
    runs/12.txt               what it has said
    records.sqlite            the records, unless they are kept elsewhere
    workbench.sqlite          jobs, accounts, sessions, tokens
"""
