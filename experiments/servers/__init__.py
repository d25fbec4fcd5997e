"""Servers of a live run: what it knows is handed to viewers on a page and to programs on the network.

A process of its own serves, so that no client can hold up the filter: `link` is the loop's end of it, `feed` the
server's. What may enter: another protocol. Each is imported from its own module.
"""
