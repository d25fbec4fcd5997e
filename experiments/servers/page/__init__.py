"""The page of a live run, and its JSON stream over WebSocket: `application` answers, `serving` serves it on a socket.

docs/live-stream.md defines the interface for viewers and programs. The page itself, plain files, is in static/.
Each is imported from its own module: the server is an extra, `softaim[live]`.
"""
