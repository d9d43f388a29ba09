"""`omnimj bench`: speed of the parts on this machine, as ratios or times within one run."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from omnimj.cli.arguments import Command, add_seed
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import announce_compilation, format_table, note_compiled


@dataclass(frozen=True)
class Effort:
    """Size of each measurement."""

    steps: int = 2000
    """Steps of the twin per round."""
    rounds: int = 7
    drive: float = 3.0
    """Duration of a driven run [s]."""
    drives: int = 20
    """Rounds of driven runs."""
    run: float = 10.0
    """Duration of the scenario [s]."""
    missions: int = 15
    """Missions over which the controller is timed."""
    mission: float = 12.0
    """Duration of a mission [s]."""
    hours: float = 1.0
    """Robot time over which the controller's memory is measured [h]."""
    longest: float = 60.0
    """Limit on the wall time of the memory measurement [s]; the remaining hours are extrapolated."""
    log: float = 60.0
    """Duration of the recorded run that is diagnosed [s]."""
    gap_runs: int = 24
    """Runs of the rig in which a hidden effect is searched for."""
    gap_axis_runs: int = 2
    """The same of the linear axis."""
    frames: int = 10_000
    """Frames per round of the codec."""
    trips: int = 5000
    """Round trips over each wire."""
    decisions: int = 20
    """Decisions of each of the robots side by side per round."""
    decision_rounds: int = 60
    """Rounds of such decisions; the shortest time counts."""
    directions: int = 24
    """Directions in which a robot on wheels is driven."""
    wheel_rounds: int = 100
    """Rounds in which its steps are timed."""


EFFORT = Effort()

_MEANING = {
    "twin_steps_per_second": "steps of 1 ms per second on one core",
    "solver_contact_ratio": "twin step / same robot, MuJoCo's contact without traction (goal ≤ 0.75)",
    "solver_friction_ratio": "twin step / the same with MuJoCo's default contact, friction included",
    "callback_share": "native callbacks / step (goal ≤ 0.35)",
    "unit_step_us": "step of the same robot with MuJoCo's contact, no traction: unit of the next ratios [µs]",
    "unit_spread": "10 to 90 % of its times in the interleaved rounds / their median",
    "diagnosed_step_ratio": "diagnosed period on the twin / step with MuJoCo's contact (goal ≤ 1.5)",
    "undiagnosed_step_ratio": "the same without diagnosis (goal ≤ 1.1)",
    "stepwise_step_ratio": "diagnosed run in the stepwise loop / the same step",
    "diagnosed_twin_to_planar_ratio": "diagnosed run on the twin / on the planar robot (goal ≥ 1.5)",
    "two_threads_speedup": "diagnosed runs on two threads / one (goal ≥ 1.9 on an idle machine)",
    "two_cores_speedup": "the same of arithmetic alone: what two cores of this machine give meanwhile",
    "batch_speedup": "two threads / one (goal ≥ 1.8 on an idle machine)",
    "scenario_realtime_factor": "× real time, with control, sensors and trace (goal ≥ 8)",
    "rerun_share": "writing the Rerun recording / the run (goal ≤ 0.15)",
    "rerun_megabytes_10_s": "size of the recording of 10 s (goal ≤ 5)",
    "control_step_median_us": "control step with diagnosis and recovery, median [µs] (goal ≤ 50)",
    "control_step_p999_us": "the same, 99.9 % [µs] (goal ≤ 200)",
    "control_growth_kb_per_hour": "memory of Python and numpy that an hour of control adds [kB] (goal: none)",
    "control_growth_hours": "time over which that was measured; the rest is extrapolated [h]",
    "control_pages_kb_per_hour": "the same in pages of the process, native code too [kB] (a few are chance)",
    "log_hours_per_minute": "hours of recorded runs that one core diagnoses in a minute",
    "gap_rig_seconds": "search for the gap in 24 rig runs on all cores [s] (goal ≤ 60)",
    "gap_simulation_ratio": "CPU time of that search / of as many bare simulations",
    "gap_axis_seconds": "search for the gap in runs of the linear axis at 1 kHz [s] (goal: 15 for 25 s)",
    "gap_axis_log_seconds": "length of these runs [s]",
    "codec_encode_us": "record to bytes, the slowest frame on UDP or serial [µs] (goal ≤ 5)",
    "codec_decode_us": "bytes to record, the same [µs] (goal ≤ 5)",
    "codec_keyed_encode_us": "record to bytes with a key's tag [µs]",
    "codec_keyed_decode_us": "bytes with a tag to record [µs]",
    "udp_round_trip_p50_us": "command there, telemetry back, loopback, two processes, median [µs]",
    "udp_round_trip_p99_us": "the same, 99 % [µs]",
    "udp_round_trip_max_us": "the same, the longest [µs]",
    "udp_bare_echo_p50_us": "as many bytes on a bare socket, in turns, median [µs]",
    "udp_bare_echo_p99_us": "the same, 99 % [µs]",
    "udp_bare_echo_max_us": "the same, the longest [µs]",
    "udp_round_trip_ratio": "median of frames / of bare bytes",
    "serial_round_trip_p50_us": "command there, telemetry back, pseudo-terminal, median [µs]",
    "serial_round_trip_p99_us": "the same, 99 % [µs]",
    "serial_round_trip_max_us": "the same, the longest [µs]",
    "serial_bare_echo_p50_us": "as many bytes on a bare pseudo-terminal, in turns, median [µs]",
    "serial_bare_echo_p99_us": "the same, 99 % [µs]",
    "serial_bare_echo_max_us": "the same, the longest [µs]",
    "serial_round_trip_ratio": "median of frames / of bare bytes",
    "environment_decisions_per_second": "decisions of 20 ms of 16 twins side by side, all cores",
    "environment_threads_speedup": "the same on two threads / one (goal ≥ 1.8 on an idle machine)",
    "environment_single_decisions_per_second": "decisions of the environment with one twin",
    "environment_planar_decisions_per_second": "decisions of 20 ms of 16 planar robots, all cores",
    "environment_planar_threads_speedup": "the same on two threads / one",
    "environment_planar_single_decisions_per_second": "decisions of the environment with one planar robot",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj bench`."""
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    words = "instead: free rolling of omni and mecanum wheels in plain MuJoCo, by shape of roller and contact"
    parser.add_argument("--wheels", action="store_true", help=words)
    add_seed(parser, "seed of the wheels' angles with --wheels", default=1)


def run(arguments: Any) -> int:
    """Measure every part; speed is reported, not judged."""
    if arguments.wheels:
        return _run_wheels(arguments)
    from omnimj.bench.control import measure_control, measure_logs
    from omnimj.bench.gap import measure_gap
    from omnimj.bench.learning import measure_environments
    from omnimj.bench.link import measure_link
    from omnimj.bench.twin import measure_driving, measure_run, measure_threads, measure_twin

    announce_compilation("twin", "uto_robot", quiet=arguments.quiet)
    found: dict[str, float] = {}
    parts: dict[str, Callable[[], Mapping[str, float]]] = {
        "twin": lambda: measure_twin(EFFORT.steps, EFFORT.rounds),
        "a run with its files": lambda: measure_run(EFFORT.run),
        "driving": lambda: measure_driving(EFFORT.drive, EFFORT.drives),
        "threads": lambda: measure_threads(EFFORT.drive, EFFORT.drives),
        "control": lambda: measure_control(EFFORT.missions, EFFORT.mission, EFFORT.hours, EFFORT.longest),
        "logs": lambda: measure_logs(EFFORT.log),
        "gap": lambda: measure_gap(EFFORT.gap_runs, EFFORT.gap_axis_runs),
        "link": lambda: measure_link(EFFORT.frames, EFFORT.trips),
        "environments": lambda: measure_environments(EFFORT.decisions, EFFORT.decision_rounds),
    }
    with progress_bar(arguments) as bar:
        for k, (name, measure) in enumerate(parts.items()):
            bar.show_share(f"measuring: {name}", k / len(parts))
            found |= measure()
    note_compiled("twin", "uto_robot")
    note_compiled("planar", "uto_robot")
    meaning = {name: words for name, words in _MEANING.items() if name in found}
    if arguments.json:
        print(json.dumps({name: float(found[name]) for name in meaning}, indent=2))
    else:
        rows = [(name, f"{found[name]:.4g}", words) for name, words in meaning.items()]
        print(format_table(("measure", "value", "meaning"), rows))
    return 0


def _run_wheels(arguments: Any) -> int:
    import dataclasses

    from omnimj.bench.wheels import HEADINGS, measure_wheels, rows

    announce_compilation("twin", "uto_robot", quiet=arguments.quiet)
    with progress_bar(arguments) as bar:
        found = measure_wheels(EFFORT.directions, arguments.seed, EFFORT.wheel_rounds, bar.show)
    note_compiled("twin", "uto_robot")
    if arguments.json:
        print(json.dumps([dataclasses.asdict(one) for one in found], indent=2))
    else:
        print(format_table(HEADINGS, rows(found)))
    return 0


BENCH = Command(
    "bench",
    "measure speed: twin, callback, batch, control, recording, gap, link",
    """examples:
  omnimj bench
  omnimj bench --json
  omnimj bench --wheels --seed 1""",
    add_arguments,
    run,
)
