"""A page for viewers and OpenIGTLink for programs, in another process.

A new protocol belongs here.
"""

# Import names from the modules themselves. `link` is the loop's side of the connection, `feed` the server's side.
