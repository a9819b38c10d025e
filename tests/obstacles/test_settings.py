from armguard.obstacles import Frame, Obstacles, Source


def test_settings_are_those_that_it_was_made_with():
    frame = Frame([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]], [1.0, 2.0, 3.0], 0.01)
    source = Source("camera", timeout=0.5)
    bounds = [("hand*", 20.0, 3.0)]
    settings = Obstacles(
        5.0, 1.5, [source], frames={"tilted": frame}, extent=50.0, bounds=bounds
    ).settings
    assert (settings.accel, settings.speed, settings.extent) == (5.0, 1.5, 50.0)
    assert settings.sources == (source,)
    assert settings.bounds == (("hand*", 20.0, 3.0),)
    assert list(settings.frames) == ["tilted"]
    assert settings.frames["tilted"].rotation.tobytes() == frame.rotation.tobytes()
    assert Obstacles().settings.sources is None
    assert Obstacles(sources=[]).settings.sources == ()
