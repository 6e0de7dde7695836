"""Many registrations at a time."""

import signal
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy
import pytest
from conftest import bracket, moved, pose

import reagent

SOURCES = [bracket(seed, 200 + 10 * seed) for seed in range(6)]
TARGETS = [moved(pose(translation=(0.02 * seed, 0, 0)), bracket(seed + 50, 300)) for seed in range(6)]


def bits(found):
    return found.target_from_source.tobytes(), found.probability, found.verdict


def test_batches_are_as_single_calls():
    policy = reagent.Policy.pretrained("int8")
    expected = [bits(reagent.Registrar(policy).register(*pair)) for pair in zip(SOURCES, TARGETS)]
    for threads in [None, 1, 2, 3]:
        registrar = reagent.Registrar(policy, threads=threads)
        assert [bits(found) for found in registrar.register_batch(SOURCES, TARGETS)] == expected


def test_one_registrar_serves_several_threads():
    registrar = reagent.Registrar(reagent.Policy.pretrained("compact"))
    expected = [bits(registrar.register(*pair)) for pair in zip(SOURCES, TARGETS)] * 4
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(registrar.register, SOURCES * 4, TARGETS * 4))
    assert [bits(one) for one in found] == expected


def test_batches_take_one_start_or_many():
    starts = numpy.stack([pose(translation=(0.02 * seed, 0, 0)) for seed in range(6)])
    views = numpy.stack([numpy.array([0.0, 0.0, 9.0 + seed]) for seed in range(6)])
    found = reagent.register_batch(SOURCES, TARGETS[0], starts, "refine", views)
    single = [
        reagent.register(source, TARGETS[0], start, "refine", view)
        for source, start, view in zip(SOURCES, starts, views)
    ]
    assert list(map(bits, found)) == list(map(bits, single))
    found = reagent.register_batch(numpy.stack([TARGETS[0]] * 2), TARGETS[0], starts[0], "refine")
    assert len(found) == 2 and bits(found[0]) == bits(found[1])
    assert reagent.register_batch([], []) == []


def test_batches_tell_the_next_best_poses():
    # Of parts: where a pose explains both clouds, hardly another is looked at.
    parts = [source[source[:, 0] > numpy.median(source[:, 0])] for source in SOURCES[:2]]
    found = reagent.register_batch(parts, TARGETS[:2], best=3)
    single = [reagent.register(*pair, best=3) for pair in zip(parts, TARGETS[:2])]
    probable = [[[other.probability for other in one.others] for one in each] for each in (found, single)]
    assert probable[0] == probable[1] and any(probable[0])


def test_what_fails_need_not_stop_the_rest():
    clouds = [SOURCES[0], SOURCES[1][:, :2], SOURCES[2] * numpy.nan, SOURCES[3]]
    with pytest.raises(reagent.CloudError, match=r"sources\[1\]: expected"):
        reagent.register_batch(clouds, TARGETS[0], mode="refine")
    found = reagent.register_batch(clouds, TARGETS[0], mode="refine", return_exceptions=True)
    kinds = [reagent.Registration, reagent.CloudError, reagent.CloudError, reagent.Registration]
    assert list(map(type, found)) == kinds
    assert str(found[2]).startswith("sources[2]: no points")


def test_the_user_may_stop_between_two_starts():
    class Stopped(Exception):
        pass

    def stop(*_):
        raise Stopped

    before = signal.signal(signal.SIGALRM, stop)
    # Far less than so many starts take.
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with pytest.raises(Stopped):
            reagent.register(SOURCES[0], TARGETS[0], [numpy.eye(4)] * 100_000)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def test_python_goes_on_meanwhile():
    running = threading.Thread(target=reagent.register_batch, args=(SOURCES * 20, TARGETS * 20))
    running.start()
    turns = 0
    while running.is_alive():
        turns += 1
    assert turns > 1000
