"""OpenIGTLink for 3D Slicer and PLUS: a codec of the messages of a live run, and the server.

Another message type belongs in `bodies`. Each is imported from its own module. Source: [openigtlink].
"""
