"""Projects of one's own: folders made from a template, and scenes checked before anything is estimated.

What may enter: what helps somebody who begins with an own phantom. Mathematics belongs to the packages below.
"""
