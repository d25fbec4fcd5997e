"""The page of a live run, and its JSON stream over WebSocket: `application` answers, `serving` serves it on a socket.

What viewers and programs may rely upon is told in docs/live-stream.md. The page itself, plain files, is in static/.
Each is imported from its own module: what serves is an extra, `softaim[live]`.
"""
