"""``python -m tests.campaign``: many missions, one table."""

import argparse
import sys
import time
import traceback
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from tests.campaign.mission import Result, fly
from tests.campaign.table import findings, lines


def main() -> int:
    """Fly, tell what went wrong as it comes, print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=main.__doc__)
    parser.add_argument("--missions", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="number of the first mission")
    parser.add_argument("--only", type=int, action="append", help="one mission, again")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--wide", action="store_true", help="more instruments, more faults")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--longest", type=float, default=600.0, help="of a mission, s")
    args = parser.parse_args()
    numbers = args.only or range(args.first, args.first + args.missions)
    begun = time.monotonic()
    results: list[Result] = []
    wrong = 0
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        how = args.longest, args.wide
        todo = [pool.submit(fly, args.seed, number, *how) for number in numbers]
        for n, (number, done) in enumerate(zip(numbers, todo, strict=True), 1):
            if crash := done.exception():
                found = ["".join(traceback.format_exception(crash))]
            else:
                results.append(done.result())
                found = findings(results[-1])
            for line in found:
                wide = " --wide" * args.wide
                again = f"python -m tests.campaign{wide} --seed {args.seed} --only {number}"
                print(f"mission {number}: {line}\n    {again}", flush=True)
            wrong += len(found)
            if sys.stderr.isatty():
                print(f"\r{n} of {len(todo)}", end="", file=sys.stderr, flush=True)
    print(*lines(results), sep="\n")
    print(f"{len(todo)} missions in {time.monotonic() - begun:.0f} s, {wrong} findings")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
