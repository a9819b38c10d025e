"""Study of extreme numbers: whether answers are sound, how tight, at what cost, or refused."""
