"""Times of validity against the truth over many seeds: `python -m tests.bench.clocks [RUNS]`."""

import sys

import numpy as np

from tests.gateway.device_clocks import Heard, inertial, sentences

RUNS = 20


def rows(label: str, runs: list[Heard], relock: tuple[float, float]) -> str:
    """RMS of all runs together, and of the worst one."""
    settled = [run.rms_ms(relock) for run in runs]
    whole = [run.rms_ms() for run in runs]
    cells = [np.sqrt(np.mean(np.square(settled))), max(settled)]
    cells += [np.sqrt(np.mean(np.square(whole))), max(whole)]
    claimed = [run.intake.clock_report().sigma_ms for run in runs]
    claim = f"{np.mean(claimed):.3f}" if None not in claimed else "-"
    return f"| {label} | " + " | ".join(f"{cell:.3f}" for cell in cells) + f" | {claim} |"


def main(count: int) -> None:
    """Print a table."""
    signs = [(-1) ** seed * 50e-6 for seed in range(count)]
    print("| ms RMS from 60 s on | settled | worst run | with the relock | worst run | claimed |")
    print("|---|---|---|---|---|---|")
    for source, label in (("device", "IMU 200 Hz, its time"), ("arrival", "IMU 200 Hz, sequence")):
        runs = [inertial(seed, source=source, drift=drift) for seed, drift in enumerate(signs)]
        print(rows(label, runs, (90.0, 102.0)), flush=True)
    for source, label in (("device", "GGA at 9600 baud, its time"), ("arrival", "GGA, arrival")):
        runs = [sentences(seed, source=source, drift=drift) for seed, drift in enumerate(signs)]
        print(rows(label, runs, (119.0, 160.0)), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else RUNS)
