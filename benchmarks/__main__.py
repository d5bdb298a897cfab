"""Measures our speed beside what people use otherwise, and prints a table.

    python -m benchmarks [--only NAME ...] [--quick] [--markdown FILE] [--json FILE] [--figure FILE]

Run it at the top of the repository, with the extra `peers`, and on a machine that does nothing else
(a few minutes). `make benchmark` does, and renews the table and figure of the documents: of a
Markdown file that exists, only what stands between its marks is replaced.
"""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from benchmarks import (
    cable_robot,
    command_line,
    follow_the_leader,
    full_twin,
    planning,
    postures,
    remote_manipulator,
    report,
    teleoperation,
)
from benchmarks.measuring import describe_machine

BENCHMARKS = {
    "follow_the_leader": follow_the_leader.measure,
    "full_twin": full_twin.measure,
    "postures": postures.measure,
    "planning": planning.measure,
    "teleoperation": teleoperation.measure,
    "remote_manipulator": remote_manipulator.measure,
    "cable_robot": cable_robot.measure,
    "command_line": command_line.measure,
}


def main(arguments: list[str] | None = None) -> None:
    """Runs what is asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--only", nargs="+", choices=BENCHMARKS, metavar="NAME", default=[])
    parser.add_argument("--quick", action="store_true", help="tiny sizes: does it run at all?")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="put the table there")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every round there")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="draw the ratios there (PNG)")
    options = parser.parse_args(arguments)
    logging.getLogger("drake").setLevel(logging.WARNING)
    lines = []
    for name in options.only or BENCHMARKS:
        print(f"measuring {name}", file=sys.stderr, flush=True)
        lines += BENCHMARKS[name](quick=options.quick)
    machine = describe_machine()
    table = report.markdown(lines, machine)
    print(table, end="")
    if options.markdown:
        text = table
        if options.markdown.exists():
            text = report.put_into(options.markdown.read_text(encoding="utf-8"), table)
        options.markdown.write_text(text, encoding="utf-8")
    if options.json:
        options.json.write_text(report.to_json(lines, machine), encoding="utf-8")
    if options.figure:
        report.draw(lines, machine, options.figure)


if __name__ == "__main__":
    main()
