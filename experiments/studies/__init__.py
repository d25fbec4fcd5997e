"""One file per published table or figure, which its docstring names.

A new study belongs here.
"""

# Nothing is imported here: each study is run as a module.
