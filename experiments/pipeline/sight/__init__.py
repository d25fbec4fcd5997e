"""From pictures to measured marks: on the plane by one camera, in space by several.

What may enter: another way in which cameras see a scene.
"""
