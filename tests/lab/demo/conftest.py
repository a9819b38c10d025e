"""Demos that are ended with their test."""

import pytest

from support.demo_processes import RunningDemo


@pytest.fixture
def start(tmp_path):
    """Starts a demo and waits until its monitor speaks."""
    demos = []

    def start_demo(*arguments):
        demo = RunningDemo(*arguments, folder=tmp_path)
        demos.append(demo)
        demo.wait_for_verdicts()
        return demo

    yield start_demo
    for demo in demos:
        demo.__exit__()
