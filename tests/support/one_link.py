"""A robot of one link, as far as a cover needs to know it."""

import numpy as np


class OneLink:
    """What a cover needs to know of a robot."""

    links = ("link",)

    def __init__(self, triangles):
        self._triangles = np.asarray(triangles, dtype=np.float64)

    def triangles(self, link):
        assert link == "link"
        return self._triangles

    def surface(self, link):
        return self.triangles(link)
