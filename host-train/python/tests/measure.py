"""Measures what a call costs beside the computation itself, and what a second thread gains: python measure.py"""

import statistics
import time

from conftest import bracket, moved, pose

import reagent


def overhead_us(source, target, registrar, calls=200):
    """Median time of a call without the computation that the result states, microseconds."""

    def once():
        before = time.perf_counter()
        found = registrar.register(source, target)
        return 1e6 * (time.perf_counter() - before) - 1e3 * found.ms

    return statistics.median(once() for _ in range(calls))


def pairs_per_second(registrar, sources, targets):
    before = time.perf_counter()
    registrar.register_batch(sources, targets)
    return len(sources) / (time.perf_counter() - before)


def main():
    registrar = reagent.Registrar(reagent.Policy.pretrained("int8"))
    for count in (256, 1024, 4096):
        source, target = bracket(1, count), moved(pose(), bracket(2, count))
        for dtype in ("float32", "float64"):
            us = overhead_us(source.astype(dtype), target.astype(dtype), registrar)
            print(f"{count} + {count} points in {dtype}: {us:.0f} us beside the computation")
    sources = [bracket(seed, 1024) for seed in range(200)]
    targets = [moved(pose(), bracket(seed + 500, 1024)) for seed in range(200)]
    registrars = [reagent.Registrar(registrar.policy, threads=threads) for threads in (1, 2)]
    gains = []
    for _ in range(5):
        one, two = (pairs_per_second(registrar, sources, targets) for registrar in registrars)
        gains.append(two / one)
        print(f"one thread {one:.0f} pairs a second, two {two:.0f}: {two / one:.2f} times")
    print(f"median {statistics.median(gains):.2f}")


if __name__ == "__main__":
    main()
