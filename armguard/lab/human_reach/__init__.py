"""A workplace to learn in: an arm in MuJoCo that carries parts past a person who reaches in."""
