from armguard.schedules import DistanceSchedule, Schedule


def test_it_asks_for_distances_and_is_otherwise_full():
    schedule: Schedule = DistanceSchedule()
    assert schedule.measure == "distance"
    schedule.insert([4, 2])
    for distances, ranking in [([0.5, 2.0], [4, 2]), ([3.0, 2.0], [2, 4])]:
        assert schedule.due().tolist() == [4, 2]
        schedule.settle(distances, 0.0)
        assert schedule.ranking().tolist() == ranking
        assert schedule.flagged().size == 0
