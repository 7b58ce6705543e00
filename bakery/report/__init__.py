"""What people look at: pages of HTML without outside resources.

`html`, with `page.css` and `slider.js`, is what all pages are made of; `page` is about an asset, whose pictures `figures`
collects, `comparison` about pictures of one scene by several methods, `gallery` shows pictures with their names.  Nothing here
knows the command line.
"""
