"""An object in a stream of clouds."""

import threading

import numpy
import pytest
from conftest import apart, bracket, moved, pose

import reagent


def seen(step, offset=(0, 0, 0)):
    """The bracket some steps on, and its pose."""
    angle = 0.03 * step
    back = pose(numpy.cos(angle), numpy.sin(angle), (0.02 * step, 0, 0))
    truth = numpy.linalg.inv(back)
    truth[:3, 3] -= truth[:3, :3] @ offset
    return moved(back, bracket(10 + step, 800)) + offset, truth


@pytest.mark.parametrize("offset", [(0, 0, 0), (5e5, 5.4e6, 0)])
def test_an_object_is_found_tracked_lost_and_found(offset):
    start = seen(0, offset)[1]
    tracker = reagent.Tracker(bracket(1, 1500), start)
    states = []
    for step in range(5):
        cloud, truth = seen(step, offset)
        found = tracker.follow(cloud)
        states.append(found.state)
        angle, distance = apart(found.target_from_source, truth) if not any(offset) else (0, 0)
        assert angle < 1 and distance < 0.05
        centre = moved(found.target_from_source, cloud).mean(axis=0)
        assert numpy.abs(centre - bracket(10 + step, 800).mean(axis=0)).max() < 0.05
    assert states == ["found"] + 4 * ["tracked"]
    noise = numpy.random.default_rng(3).normal(size=(800, 3)) + offset
    assert tracker.follow(noise).state == "lost"
    assert tracker.follow(seen(5, offset)[0]).state == "found"
    with pytest.raises(reagent.CloudError, match="source"):
        tracker.follow(numpy.zeros((0, 3)))
    assert tracker.follow(seen(5, offset)[0]).state == "found"


def test_registrations_besides_have_no_state(pair):
    source, target, _ = pair
    assert reagent.register(source, target).state is None


def test_what_it_takes():
    model = bracket(1, 500)
    assert reagent.Tracker(model).policy.name == "compact"
    assert reagent.Tracker(model, viewpoint=[0, 0, 9]).policy.name == "views-compact"
    own = reagent.Policy.pretrained("int8")
    assert repr(reagent.Tracker(model, policy=own)) == "Tracker(Policy('int8', format='int8'))"
    for arguments, what in [
        ({"init": ["identity", "anywhere"]}, "init: expected one start"),
        ({"mode": "fast"}, "mode: fast does not"),
        ({"points": 3}, "points: expected"),
        ({"viewpoint": [[0, 0, 0]]}, "viewpoint: expected one"),
    ]:
        with pytest.raises(reagent.Error, match=what):
            reagent.Tracker(model, **arguments)
    with pytest.raises(reagent.CloudError, match="target"):
        reagent.Tracker(numpy.zeros((0, 3)))


def test_threads_take_turns():
    tracker, states = reagent.Tracker(bracket(1, 800)), []

    def follow():
        for _ in range(5):
            states.append(tracker.follow(bracket(2, 800)).state)

    threads = [threading.Thread(target=follow) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(states) == ["found"] + 14 * ["tracked"]


def test_a_cloud_of_another_shape_counts_as_one_without_the_object(pair):
    source, target, _ = pair
    tracker = reagent.Tracker(target, "anywhere")
    assert tracker.follow(source).state == "found"
    found = tracker.follow(source)
    assert found.state == "tracked" and "state='tracked'" in repr(found)
    with pytest.raises(reagent.CloudError):
        tracker.follow(source.T)
    assert tracker.follow(source).state == "found"
