"""One file for each published table or figure, named in its docstring.

What may enter: another study.
"""

# Nothing is imported here: each study is run as a module.
