"""What log, plan or estimate say of themselves. Nothing here changes an estimate.

Files here hold for any method. A folder has the name of what is diagnosed, and its files the same
names in all: `input` refuses what is wrong before anything is estimated, `checks` judge the
result and make its verdict, `report` makes the tables and findings that the report shows.
"""
