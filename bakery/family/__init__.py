"""Families: the assets of a swept recipe, and one file whose tables have the swept axes.

`axes.py` says what is swept, `refine.py` where points are needed, `tree.py` what the file holds; `point.py` makes the asset of
any place between them, `members.py` holds the members' files against what the family says, `pictures.py` draws.
"""
