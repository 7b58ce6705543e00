"""What people look at: pictures, tables in text, one page.

`summary` says in plain values what an asset holds, `text` prints for terminals, `figures` draws, `style` keeps the look and the
bytes the same everywhere, `page` puts all of it into one HTML file.  Nothing here knows the command line.
"""
