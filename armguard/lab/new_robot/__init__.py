"""`armguard robot new`: makes a robot.toml and a proved cover for a new arm from its URDF.

`sources` finds the files, `limits` what the model file has and what is usual where it has nothing,
`questions` asks for the rest, `text` writes robot.toml, and `command` does all of it in
turn.
"""
