"""What a hunt came to."""

from typing import NamedTuple

import numpy as np


class Score(NamedTuple):
    """What a hunt came to."""

    pair_ticks: int = 0
    """Links times obstacles times ticks."""
    near: int = 0
    """Of these, those that do not touch and truly could within 50 ms: counted by what is tried out,
    so rather too few than too many."""
    near_open: int = 0
    """Of these, those whose arm was told to go on, or still moves."""
    ticks: int = 0
    goes: int = 0
    """Ticks whose verdict was no STOP."""
    tried: int = 0
    """Balls so near at a GO that their attacks were tried one by one."""
    missed: int = 0
    """Balls that could have been touched harmfully before the arm rests that was told to go on."""
    early: int = 0
    """Contacts that were possible before the contact time said so."""
    too_fast: int = 0
    """Contacts that were possible though the arm would keep to its speed scale and then brake."""
    harmful: int = 0
    """Contacts that no limit permits, and that were possible before the harm time said so."""
    hits: int = 0
    """Contacts with an arm that was not at rest, and that no limit permits."""
    gentle: int = 0
    """Contacts that limits permit, with an arm that was not at rest."""
    allowed: int = 0
    """Attacks after a GO that could touch the arm before it rests, as limits permit."""
    understated: int = 0
    """Of these attacks, those in which a leaf is faster than the verdict's contact speed."""
    closest: float = 0.0
    """How fast a leaf is at the most in these two, as a fraction of its limit."""
    touches: int = 0
    """Ticks in which a ball touched the arm at rest."""
    worst: float = np.inf
    """The least that an attack lacked after a GO, in [m]."""
    worst_time: float = np.inf
    """The least that an attack within the contact time lacked, in [m]."""
    worst_harm: float = np.inf
    """The least that an attack within the harm time lacked to do harm, in [m]."""
    worst_scale: float = np.inf
    """The least that an attack on an arm lacked that keeps to its speed scale, in [m]."""
    stops: int = 0
    """Changes from GO to STOP."""
    faults: int = 0
    """Ticks that were incomplete or in which the monitor believed that bounds were broken."""
