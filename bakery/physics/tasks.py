"""How physics has its work done where nobody says how."""


def in_turn(function, tasks) -> list:
    """`function(*task)` of each task, one after the other."""
    return [function(*task) for task in tasks]
