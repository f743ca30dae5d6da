#!/usr/bin/env python3
"""Compares two revisions by the JSON of the same benchmarks with the same seeds.

Every figure is paired with itself: cells of tables over the seeds, raw values over the items (cars,
scenes, clouds) of all seeds. Printed are both means, the mean of the paired differences and its
standard error. Items of one group (what stands before the '/' of their name: a scene) are not taken
for independent, so that the error is that of the group's sums. Timings are left out.

A figure is 'identical' or 'equal' (to rounding), else 'better' or 'WORSE' where its mean difference
is beyond two standard errors, 'within' where it is not, 'changed' where no direction is better or
there is no standard error (one pair, one group), 'LOST' where the new runs lack what the reference
has.

Exit code: 0, 1 if anything is WORSE or LOST, 2 for bad input.
"""

import argparse
import math
import sys

from benchmark_json import BadInput, labels_of, read_runs


class Figure:
    """The pairs of one figure and what they say."""

    def __init__(self, program, table, name, column):
        self.program, self.table, self.name = program, table, name  # table: a heading
        self.unit = column.get("unit", "")
        self.better = column.get("better")
        self.pairs = []  # (group, reference, now)
        self.lost = self.gained = 0

    def add(self, group, reference, now):
        if reference is not None and now is not None:
            self.pairs.append((group, reference, now))
        elif reference is not None:
            self.lost += 1
        elif now is not None:
            self.gained += 1

    def judge(self, rounding):
        """Sets mean, error (None: not known) and verdict."""
        differences = [now - reference for _, reference, now in self.pairs]
        count = len(differences)
        scale = max((max(abs(r), abs(n)) for _, r, n in self.pairs), default=0.0)
        largest = max(map(abs, differences), default=0.0)
        self.relative = largest / scale if scale > 0.0 else 0.0
        self.mean_reference = sum(r for _, r, _ in self.pairs) / count if count else math.nan
        self.mean = sum(differences) / count if count else math.nan
        self.error = standard_error([group for group, _, _ in self.pairs], differences)
        self.verdict = self.verdict_of(largest, rounding)

    def verdict_of(self, largest, rounding):
        if self.lost:
            return "LOST"
        if self.gained:
            return "changed"
        if largest == 0.0:
            return "identical"
        if self.relative <= rounding:
            return "equal"
        if self.better is None or self.error is None:
            return "changed"
        if abs(self.mean) <= 2.0 * self.error:
            return "within"
        return "better" if (self.mean < 0.0) == (self.better == "lower") else "WORSE"

    def line(self):
        unit = f" {self.unit}" if self.unit else ""
        if not self.pairs:
            numbers = "no pairs"
        else:
            error = "?" if self.error is None else f"{self.error:.2g}"
            numbers = (f"{self.mean_reference:.6g} -> {self.mean_reference + self.mean:.6g}{unit}, "
                       f"{self.mean:+.3g} +- {error} ({len(self.pairs)} pairs)")
        for count, what in ((self.lost, "lost"), (self.gained, "new")):
            if count:
                numbers += f", {count} {what}"
        return f"  {self.verdict:9} {self.name}: {numbers}"


def standard_error(groups, values):
    """Of the mean, with sums over groups as the independent parts; None with fewer than two."""
    parts = {}
    mean = sum(values) / len(values) if values else 0.0
    for group, value in zip(groups, values):
        parts[group] = parts.get(group, 0.0) + value - mean
    if len(parts) < 2:
        return None
    squares = sum(part * part for part in parts.values())
    return math.sqrt(len(parts) / (len(parts) - 1) * squares) / len(values)


def compared_columns(columns):
    return [(i, column) for i, column in enumerate(columns)
            if not column.get("label") and not column.get("timing")]


def what_was_run(runs):
    """{(key, seed)} of all tables and items."""
    return {(key, run.seed) for run in runs
            for key in [*run.tables(), *run.data["items"]]}


def table_cells(runs):
    """{(table, figure): (column, {seed: value})}, {table: title}."""
    cells, titles = {}, {}
    for run in runs:
        for key, table in run.tables().items():
            titles[key] = table["name"]
            for row in table["rows"]:
                label = labels_of(table, row)
                for i, column in compared_columns(table["columns"]):
                    name = f"{label}: {column['name']}" if label else column["name"]
                    values = cells.setdefault((key, name), (column, {}))[1]
                    if run.seed in values:
                        raise BadInput(f"{run.path}: table '{key}' is in two files of the set")
                    values[run.seed] = row[i]
    return cells, titles


def item_values(runs):
    """{(items, figure): (column, {(seed, item): value})}."""
    values = {}
    for run in runs:
        for key, items in run.data["items"].items():
            for i, column in compared_columns(items["columns"]):
                of_column = values.setdefault((key, column["name"]), (column, {}))[1]
                for item, row in items["values"].items():
                    if (run.seed, item) in of_column:
                        raise BadInput(f"{run.path}: items '{key}' are in two files of the set")
                    of_column[run.seed, item] = row[i]
    return values


def pair(program, headings, reference, now, common, seed_and_group):
    """Figures of what is on both sides: tables and items that a side was not asked for (with that
    seed) do not count, single rows and items that it lacks do."""
    figures = []
    for place in sorted(set(reference) | set(now)):
        column, before = reference.get(place, (None, {}))
        if column is None:
            column = now[place][0]
        after = now.get(place, (None, {}))[1]
        figure = Figure(program, headings(place[0]), place[1], column)
        for key in sorted(set(before) | set(after)):
            seed, group = seed_and_group(key)
            if (place[0], seed) in common:
                figure.add(group, before.get(key), after.get(key))
        if figure.pairs or figure.lost or figure.gained:
            figures.append(figure)
    return figures


def compare(reference_runs, now_runs):
    """Figures of all programs and seeds that both sets have, and remarks on what they have not."""
    figures, remarks = [], []
    for program in sorted({r.program for r in reference_runs} | {r.program for r in now_runs}):
        sides = [[r for r in runs if r.program == program] for runs in (reference_runs, now_runs)]
        seeds = [{r.seed for r in side} for side in sides]
        common = seeds[0] & seeds[1]
        if seeds[0] != seeds[1]:
            remarks.append(
                f"{program}: seeds {seeds[0] and sorted(seeds[0])} in the reference, "
                f"{seeds[1] and sorted(seeds[1])} now; compared: {sorted(common) or 'none'}")
        sides = [[r for r in side if r.seed in common] for side in sides]
        options = [{str(r.measuring_options()) for r in side} for side in sides]
        if options[0] != options[1]:
            raise BadInput(f"{program}: run with other options: {sorted(options[0])} in the "
                           f"reference, {sorted(options[1])} now")
        before, titles = table_cells(sides[0])
        after, _ = table_cells(sides[1])
        run = [what_was_run(side) for side in sides]
        absent = {key for key, _ in run[0] - run[1]}
        if absent and common:
            remarks.append(f"{program}: not run now, with some or all of these seeds: "
                           f"{', '.join(sorted(absent))}")
        figures += pair(program, lambda key: f"table {key} ({titles.get(key, 'new')})", before,
                        after, run[0] & run[1], lambda seed: (seed, seed))
        figures += pair(program, lambda key: f"items {key}", item_values(sides[0]),
                        item_values(sides[1]), run[0] & run[1],
                        lambda key: (key[0], key[1].split("/")[0]))
    return figures, remarks


def print_figures(figures, show_all):
    tables = {}
    for figure in figures:
        tables.setdefault((figure.program, figure.table), []).append(figure)
    for (program, table), of_table in tables.items():
        same = [f for f in of_table if f.verdict in ("identical", "equal")]
        print(f"{program}, {table}: {len(same)} of {len(of_table)} figures equal")
        for figure in of_table:
            if show_all or figure not in same:
                print(figure.line())


def print_summary(figures, rounding):
    counts = {}
    for figure in figures:
        counts[figure.verdict] = counts.get(figure.verdict, 0) + 1
    order = ("identical", "equal", "better", "within", "changed", "WORSE", "LOST")
    print(f"\n{len(figures)} figures: "
          + ", ".join(f"{counts[v]} {v}" for v in order if v in counts))
    equal = [f for f in figures if f.verdict == "equal"]
    if equal:
        largest = max(f.relative for f in equal)
        print(f"equal to rounding: largest difference {largest:.1e} of the figure's largest value "
              f"(up to {rounding:.0e} counts as rounding)")
    judged = sum(counts.get(v, 0) for v in ("better", "within", "WORSE"))
    if judged:
        print(f"of the {judged} that differ and have a standard error, chance alone puts about "
              f"{max(1, round(0.023 * judged))} beyond two of them on the worse side, more where "
              "pairs are few")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reference", nargs="+", required=True, metavar="FILE|DIR")
    parser.add_argument("--now", nargs="+", required=True, metavar="FILE|DIR")
    parser.add_argument("--rounding", type=float, default=1e-6, metavar="R",
                        help="differences up to R times a figure's largest value are rounding "
                             "(default: 1e-6)")
    parser.add_argument("--all", action="store_true", help="also list the figures that are equal")
    arguments = parser.parse_args()
    try:
        reference, now = read_runs(arguments.reference), read_runs(arguments.now)
        figures, remarks = compare(reference, now)
        if not figures:
            raise BadInput("the two sets have no figure in common")
    except BadInput as error:
        print(f"compare_revisions.py: {error}", file=sys.stderr)
        return 2
    for runs, what in ((reference, "reference"), (now, "now")):
        print(f"{what}: revision {', '.join(sorted({r.revision for r in runs}))}, library "
              f"{', '.join(sorted({r.data.get('library_tree', 'unknown') for r in runs}))}")
    for remark in remarks:
        print(remark)
    print()
    for figure in figures:
        figure.judge(arguments.rounding)
    print_figures(figures, arguments.all)
    print_summary(figures, arguments.rounding)
    return 1 if any(f.verdict in ("WORSE", "LOST") for f in figures) else 0


if __name__ == "__main__":
    sys.exit(main())
