"""OpenIGTLink for 3D Slicer and PLUS: a codec of the messages of a live run, and the server.

A new message type belongs in the module `bodies`. Import names from the modules themselves. Source: [openigtlink].
"""
