"""Sphere files as other programs write them."""


def as_curobo(spheres):
    return {
        "collision_spheres": {
            link: [{"center": row[:3], "radius": row[3]} for row in rows]
            for link, rows in spheres.items()
        }
    }
