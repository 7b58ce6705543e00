"""Grains that look and measure like the ones on the table: shapes for `shapes.build`, by name.

What each measures stands in docs/grain-shapes.md.  A different seed gives another grain of the kind; four to eight of them,
turned at random, make a heap.
"""

EXAMPLES = {
    "glass beads": {"type": "sphere"},
    "sand": {"type": "rock", "seed": 3, "axes": (1.0, 0.8, 0.65), "corners": 45, "sharpness": 24, "roughness": 0.05},
    "gravel": {"type": "rock", "seed": 6, "axes": (1.0, 0.85, 0.6), "corners": 18, "sharpness": 60, "roughness": 0.03},
    "pebble": {"type": "rock", "seed": 2, "axes": (1.0, 0.8, 0.5), "corners": 60, "sharpness": 8, "roughness": 0.01},
    "salt": {"type": "crystal", "seed": 4, "habit": "cube", "axes": (1.0, 0.95, 0.9), "chips": 4, "depth": 0.15, "sharpness": 60,
             "roughness": 0.008},
    "pink salt": {"type": "crystal", "seed": 5, "habit": "cube", "axes": (1.0, 0.75, 0.5), "chips": 8, "depth": 0.3,
                  "sharpness": 80, "roughness": 0.012},
    "cane sugar": {"type": "crystal", "seed": 1, "habit": "sucrose", "axes": (1.0, 0.8, 1.0), "chips": 9, "depth": 0.3,
                   "sharpness": 20, "roughness": 0.006},
    "brown sugar": {"type": "crystal", "seed": 2, "habit": "sucrose", "axes": (1.0, 0.75, 1.0), "chips": 9, "depth": 0.3,
                    "sharpness": 10, "roughness": 0.05},
    "snow": {"type": "aggregate", "seed": 1, "arrangement": "star", "bodies": 9, "smallest": 0.7, "length": 1.2, "blend": 0.12},
    "sintered snow": {"type": "aggregate", "seed": 5, "arrangement": "cluster", "bodies": 5, "smallest": 0.6, "length": 0.8,
                      "overlap": 0.4, "blend": 0.12},
    "flour": {"type": "aggregate", "seed": 3, "arrangement": "cluster", "bodies": 8, "smallest": 0.6, "overlap": 1.4,
              "blend": 0.03},
}
