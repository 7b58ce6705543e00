"""Assets on disk: HDF5 in and out, hashes, checks.  Knows neither recipes nor stages.

`tree` is what is stored, `image` turns it into the bytes of an HDF5 file, `decode` and `read` turn those back, `hashes` says
what must agree, `write` puts a file in its place whole or not at all, `files` makes every file call, `container` fixes
names and limits.
"""
