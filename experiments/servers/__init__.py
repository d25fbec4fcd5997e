"""A page for viewers and OpenIGTLink for programs, in separate processes.

Another protocol belongs here.
"""

# Import each from its own module. `link` is the loop's end of a server, `feed` the server's.
