"""One file for each published table or figure, named in its docstring.

Another study belongs here.
"""

# Nothing is imported here: each study is run as a module.
