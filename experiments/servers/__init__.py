"""A page for viewers and OpenIGTLink for programs, in separate processes.

What may enter: another protocol.
"""

# Import each from its own module. `link` is the loop's end of a server, `feed` the server's.
