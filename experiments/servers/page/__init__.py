"""The page of a live run, and its JSON stream over WebSocket: `serving` serves both on a socket.

docs/live-stream.md defines the interface for viewers and programs. The page itself consists of plain files in static/.
Import names from the modules themselves, because the server needs the extra `softaim[live]`.
"""
