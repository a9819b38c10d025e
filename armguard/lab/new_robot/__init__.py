"""`armguard robot new`: makes a robot.toml and a proved cover for a new arm from its URDF.

`sources` finds the files. `limits` reads the model file and computes default values for missing
limits. `questions` asks for the rest, `text` writes robot.toml, and `command` runs all of these.
"""
