"""Does vnav refuse in one line, or answer as if nothing had been, whatever it is given?

    python benchmarks/attack.py [--seed 0] [--cases 5000] [--only maps] [--record]
    python benchmarks/attack.py --seed 0 --again maps:137

Captures, photos, settings, maps, arguments and circumstances are spoilt as the seed draws them, and
vnav is asked. A fault is a traceback, a crash, a hang, more memory than allowed, or an answer that
differs from the undisturbed one in silence. Cases run in processes that are replaced when they die;
every twentieth, and every one with a disturbance, is a command of its own. Exit code 1 where there
is a fault; each is told with the command that runs it again.
"""

import argparse
import itertools
import os
import shutil
import sys
import tempfile
import threading
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from attacks import arguments, captures, faults, maps, photos, readers, settings, shell
from attacks.attempt import Attempt, Disturbance, Result, fault
from attacks.ground import Ground, digests, made
from attacks.worker import Worker, vnav
from recording import Measurement, add_record_option, conclude

Maker = Callable[[np.random.Generator, Path], Attempt]
CLASSES: dict[str, tuple[Maker, float]] = {  # and their shares of all cases
    "maps": (maps.attempt, 0.30),
    "readers": (readers.attempt, 0.22),
    "captures": (captures.attempt, 0.14),
    "photos": (photos.attempt, 0.12),
    "settings": (settings.attempt, 0.12),
    "arguments": (arguments.attempt, 0.06),
    "faults": (faults.attempt, 0.04),
}
SHELL_EVERY = 20
RECORD = "stage.json"  # which names the content of a stage's inputs, that may be crafted
GB = 2**30


@dataclass(frozen=True)
class Outcome:
    """What one case came to: "refused", "same", "other" (a clean answer, not the undisturbed
    one's, and legal), or the fault."""

    kind: str
    number: int
    what: str
    came_to: str
    result: Result


class Attack:
    """Runs cases on a ground: each thread with a worker of its own."""

    def __init__(self, ground: Ground, seed: int, *, seconds: float, memory_gb: float) -> None:
        self.ground, self._seed = ground, seed
        self._seconds, self._memory = seconds, int(memory_gb * GB)
        self._own = threading.local()
        self._workers: list[Worker] = []
        self._intact: dict[tuple[object, ...], Result] = {}

    def run(self, kind: str, number: int, *, keep: bool = False) -> Outcome:
        """One case."""
        folder = Path(tempfile.mkdtemp(prefix=f"{kind}-{number}-", dir=self.ground.root))
        folder.chmod(0o755)
        try:
            self.ground.lay_out(folder)
            rng = np.random.default_rng([self._seed, zlib.crc32(kind.encode()), number])
            attempt = CLASSES[kind][0](rng, folder)
            if attempt.command and number % SHELL_EVERY == 0 and attempt.disturbance is None:
                attempt = replace(attempt, disturbance=Disturbance())
            return self.tried(kind, number, attempt, folder)
        finally:
            if keep:
                print(f"kept: {folder}", file=sys.stderr)
            else:
                for path in (folder, *(p for p in folder.rglob("*") if p.is_dir())):
                    path.chmod(0o755)  # read-only, in some cases
                shutil.rmtree(folder, ignore_errors=True)

    def tried(self, kind: str, number: int, attempt: Attempt, folder: Path) -> Outcome:
        """What an attempt in a folder that is ready for it came to."""
        result = self._result(attempt, folder)

        def intact() -> Result:
            return self.intact(attempt.undisturbed, attempt.outputs)

        wrong = fault(attempt, result, intact)
        if not wrong and attempt.again:
            result = self._result(replace(attempt, disturbance=Disturbance()), folder)
            if result.files != intact().files or result.code != intact().code:
                wrong = "not as if nothing had been when run again"
        came_to = wrong and f"fault: {wrong}" or self._clean(attempt, result, intact)
        return Outcome(kind, number, attempt.what, came_to, result)

    def _clean(self, attempt: Attempt, result: Result, intact: Callable[[], Result]) -> str:
        if result.code in (1, 2):
            return "refused"
        known = self._intact.get((attempt.undisturbed, attempt.outputs))
        return "same" if known and known.answer == result.answer else "other"

    def intact(self, command: tuple[str, ...], outputs: tuple[str, ...]) -> Result:
        """The answer of a command on the ground as it is."""
        key = command, outputs
        if key not in self._intact:
            folder = Path(tempfile.mkdtemp(prefix="intact-", dir=self.ground.root))
            self.ground.lay_out(folder)
            attempt = Attempt("nothing", command, outputs=outputs)
            self._intact[key] = self._result(attempt, folder)
            shutil.rmtree(folder)
            if self._intact[key].ended or self._intact[key].code in (1, 2):
                raise RuntimeError(f"{' '.join(command)} fails undisturbed: {self._intact[key]}")
        return self._intact[key]

    def _result(self, attempt: Attempt, folder: Path) -> Result:
        if attempt.disturbance is not None:
            result = shell.run(attempt.command, folder, self._seconds, attempt.disturbance)
        else:
            call = attempt.call or (vnav, attempt.command)
            result = self._worker().run(call, folder)
        files = digests(folder, attempt.outputs)
        made = {name: digest for name, digest in files.items() if not name.endswith(RECORD)}
        return replace(result, files=made)

    def _worker(self) -> Worker:
        if not hasattr(self._own, "worker"):
            self._own.worker = Worker(self._memory, self._seconds)
            self._workers.append(self._own.worker)
        worker: Worker = self._own.worker
        return worker

    def close(self) -> None:
        """End all processes."""
        for worker in self._workers:
            worker.close()


def numbers(cases: int, only: Sequence[str]) -> Iterator[tuple[str, int]]:
    """Class and number of each case: by the shares of the classes, in turn."""
    shares = {kind: share for kind, (_, share) in CLASSES.items() if kind in only or not only}
    total = sum(shares.values())
    each = {kind: round(cases * share / total) for kind, share in shares.items()}
    rows = [[(kind, n) for n in range(count)] for kind, count in each.items()]
    mixed = itertools.zip_longest(*rows)
    return (case for row in mixed for case in row if case is not None)


def all_outcomes(attack: Attack, cases: Sequence[tuple[str, int]], jobs: int) -> list[Outcome]:
    """What each case came to; faults are told as they are found."""
    outcomes = []
    with ThreadPoolExecutor(jobs) as pool:
        for done, outcome in enumerate(pool.map(lambda case: attack.run(*case), cases), 1):
            outcomes.append(outcome)
            if outcome.came_to.startswith("fault"):
                print(f"{outcome.kind}:{outcome.number}: {outcome.what[:300]}")
                print(f"    {outcome.came_to}", flush=True)
            if done % 100 == 0:
                print(f"{done} of {len(cases)}", file=sys.stderr, flush=True)
    return outcomes


def measured(outcomes: Sequence[Outcome]) -> list[Measurement]:
    """A row for each class."""
    found = []
    for kind in dict.fromkeys(outcome.kind for outcome in outcomes):
        came_to = Counter(o.came_to.partition(":")[0] for o in outcomes if o.kind == kind)
        row = {"cases": came_to.total(), "refused": came_to["refused"]}
        row |= {"answered the same": came_to["same"], "answered otherwise": came_to["other"]}
        found += [Measurement("hostile input", kind, name, count) for name, count in row.items()]
        wanted = "at most 0"
        found.append(Measurement("hostile input", kind, "faults", came_to["fault"], "", wanted))
    return found


def main(arguments_: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=int, default=5000)
    parser.add_argument("--only", nargs="+", choices=CLASSES, default=[], metavar="CLASS")
    parser.add_argument("--again", metavar="CLASS:NUMBER", help="one case, and all it said")
    parser.add_argument("--ground", type=Path, help="folder for what is attacked, kept")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--seconds", type=float, default=120, help="a longer call hangs")
    parser.add_argument("--memory", type=float, default=8, help="GB of address space of a call")
    add_record_option(parser)
    asked = parser.parse_args(arguments_)
    with tempfile.TemporaryDirectory(prefix="attack-") as temporary:
        ground = made(asked.ground or Path(temporary))
        attack = Attack(ground, asked.seed, seconds=asked.seconds, memory_gb=asked.memory)
        try:
            if asked.again:
                return tell_again(attack, asked.again)
            return run_all(attack, asked, arguments_)
        finally:
            attack.close()


def tell_again(attack: Attack, case: str) -> int:
    """Run one case, and print all of it."""
    kind, _, number = case.partition(":")
    outcome = attack.run(kind, int(number), keep=True)
    result = outcome.result
    print(f"{outcome.what}\nexit {result.code} {result.ended}\n{result.out[-5000:]}")
    print(f"{result.err[-5000:]}\n{outcome.came_to}")
    return int(outcome.came_to.startswith("fault"))


def run_all(attack: Attack, asked: argparse.Namespace, given: Sequence[str] | None) -> int:
    """All cases; the ground must be what it was."""
    before = attack.ground.digest()
    outcomes = all_outcomes(attack, list(numbers(asked.cases, asked.only)), asked.jobs)
    code = conclude("attack", measured(outcomes), asked, given)
    for outcome in outcomes:
        if outcome.came_to.startswith("fault"):
            print(
                f"python benchmarks/attack.py --seed {asked.seed}"
                f" --again {outcome.kind}:{outcome.number}  # {outcome.came_to}"
            )
    if attack.ground.digest() != before:
        print("fault: a case wrote to what it was given as a link")
        return 1
    return code


if __name__ == "__main__":
    sys.exit(main())
