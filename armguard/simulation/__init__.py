"""Simulated arms, people and parts, and recordings of real people, for demos and studies.

What is published here is taken as real perception is: by `Obstacles.update`.
"""

from armguard.simulation.arm import SimulatedArm
from armguard.simulation.balls import WanderingBalls
from armguard.simulation.person import ProceduralPerson
from armguard.simulation.recordings import Recording
from armguard.simulation.sources import ObstacleSink, ObstacleSource
from armguard.simulation.trajectory import JointTrajectory, keeps_within, random_trajectory

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
