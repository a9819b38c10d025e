"""Simulated arms, people and parts, and recordings of real people, for demos and studies.

What is published here is taken as real perception is: by `Obstacles.update`.
"""

from armguard.lab.simulation.arm import SimulatedArm
from armguard.lab.simulation.balls import WanderingBalls
from armguard.lab.simulation.person import ProceduralPerson
from armguard.lab.simulation.recordings import Recording
from armguard.lab.simulation.sources import ObstacleSink, ObstacleSource
from armguard.lab.simulation.trajectory import JointTrajectory, keeps_within, random_trajectory

__all__ = [
    "JointTrajectory",
    "ObstacleSink",
    "ObstacleSource",
    "ProceduralPerson",
    "Recording",
    "SimulatedArm",
    "WanderingBalls",
    "keeps_within",
    "random_trajectory",
]
