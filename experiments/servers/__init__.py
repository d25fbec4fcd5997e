"""A page for viewers and OpenIGTLink for programs, in separate processes.

A new protocol belongs here.
"""

# Import each from its own module. `link` is the loop's side of the connection, `feed` the server's side.
