"""Training sets: a data set of `testbed run` as Parquet shards that other programs open, with a card and a datasheet.

`groups` decides which runs are held out, `schema` names and describes the columns, `shards` streams the rows, `card`,
`datasheet` and `croissant` write what a stranger needs to know, `reading` says of an exported folder what it is.
Only pyarrow is needed, from the extra `formats`.
"""
