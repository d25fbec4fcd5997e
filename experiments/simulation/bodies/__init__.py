"""Bodies in motion by MuJoCo: truths that are not made by the equations of this project.

MuJoCo comes with the `dev` extra. Each body is a `Body`: what a user would write down of it, and how it moved.
"""
