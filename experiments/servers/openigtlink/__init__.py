"""OpenIGTLink for 3D Slicer and PLUS: a codec of the messages that a live run sends and takes, and the server.

What may enter: another message type, in `bodies`. Each is imported from its own module. Source: [openigtlink].
"""
