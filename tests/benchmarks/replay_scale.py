#!/usr/bin/env python3
"""The belief about the scale, replayed over the runs of trust.py without running them again.

Reads runs.jsonl (and the scenes.jsonl beside it) of one or several --out folders of trust.py, fits
the belief's parameters by the log score on even numbers and reports odd ones, beside the decisions
that the runs were made with. For example:

  replay_scale.py --runs trust_steep trust_made --fit

Score: natural logarithm of the density at the true scale, mean over all runs of scenes that should
be answered (that move, and show near road where that is known); a run without an answer, or up to
scale, scores as uniform over +- ln 10. Of runs with a fault those count that something in the
images contradicts (trust_report.contradicted), in the fit with --fault-weight each: faults are
rare, and what nothing contradicts cannot be known. Good of these: weak, refused, warned of or
inside 3 sigma; of the belief warned of where a second mode has more than 5 %. Today's decisions
score as (1 - e) Student(k sigma) + e uniform, with e, k and the freedom fitted on the same even
numbers. Differences are paired by scene, with the standard error of their mean over scenes.

Exit code: 0, 2 for bad input.
"""

import argparse
import collections
import json
import math
import pathlib
import subprocess
import sys
import tempfile

import trust_report
from benchmark_json import BadInput

REACH = math.log(10.0)
UNIFORM = -math.log(2.0 * REACH)
WEAK_SIGMA = 0.05
PROPORTIONS_SIGMA = 0.22  # of all factors by proportions in 38 sound runs over rendered roads
WEAK_MASS = 0.05

# The belief's parameters: where the search begins, and whether it goes on in the logarithm
# (positive numbers), in the logit (shares) or as it is.
START = {
    "noise.height": (0.002, "log"),
    "noise.road_shape": (0.002, "log"),
    "noise.size_population": (0.04, "log"),
    "noise.wrong_focal_length": (0.02, "logit"),
    "noise.focal_length_spread": (0.5, "log"),
    "noise.vehicles_by_focal_length": (0.5, "plain"),
    "camera_height.spread": (1.0, "log"),
    "camera_height.freedom": (4.0, "log"),
    "camera_height.wrong_share": (0.01, "logit"),
    "vehicle.freedom": (3.0, "log"),
    "lane_markings.spread": (1.0, "log"),
    "lane_markings.wrong_share": (0.05, "logit"),
    "plane_search.spread": (1.0, "log"),
    "plane_search.wrong_share": (0.05, "logit"),
    "intensities.wrong_share": (0.5, "logit"),
    "vehicle.spread": (1.0, "log"),
    "vehicle.wrong_share": (0.05, "logit"),
    "focal_length.spread": (1.0, "log"),
    "focal_length.wrong_share": (0.05, "logit"),
    "layer.base": (-4.0, "plain"),
    "layer.unfound": (6.15, "plain"),
    "layer.disagreeing": (8.0, "plain"),
    "layer.ambiguous": (1.85, "plain"),
    "layer.informative": (-0.92, "plain"),
}
# Not fitted: too few runs show them. As RoadLayer::log_odds() has them.
FIXED_LAYER = {"off_road": 8.0, "obstacles": 80.0}


def parse(words):
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--runs", type=pathlib.Path, nargs="+", required=True, metavar="FOLDER",
        help="of trust.py's --out")
    add("--program", type=pathlib.Path,
        default=pathlib.Path("build/release/bin/bench_replay_scale"), metavar="PATH",
        help="default: build/release/bin/bench_replay_scale")
    add("--fit", action="store_true", help="fit on even numbers; else with the parameters given")
    add("--fault-weight", type=float, default=0.1, help="of a run with a fault in the fit")
    add("--rounds", type=int, default=2, help="of the fit, over all parameters")
    add("--parameters", type=pathlib.Path, metavar="FILE", help="read from there, if it is there; "
        "with --fit also written")
    add("--json", type=pathlib.Path, metavar="FILE", help="the report")
    return parser.parse_args(words)


# --- cases ---------------------------------------------------------------------------------------

class Case:
    """A run of a scene that should be answered."""

    def __init__(self, entry, weight):
        definition, result = entry["definition"], entry["result"]
        maker = definition["maker"]
        self.weight = weight
        self.scene = (maker, definition["scene"])
        self.even = entry["number"] % 2 == 0
        self.fault = definition["fault"]
        self.answered = trust_report.has_error(entry)
        self.error = result.get("error") if self.answered else None
        self.sigma = result.get("sigma") if self.answered else None
        self.weak = not self.answered or result["status"] != "ok"
        self.good = trust_report.verdict_of(entry) != "wrong" or self.weak
        self.evidence = [with_sigma(e) for e in result.get("evidence") or []]
        layer = next((e for e in self.evidence if e["name"] == "road_layer"), None)
        self.layer = layer.get("measured", {}) if layer else None


def with_sigma(evidence):
    """Vehicles whose proportions fit the given focal length best state no sigma of it."""
    if evidence["name"] == "focal_length" and evidence["sigma"] is None:
        return {**evidence, "sigma": PROPORTIONS_SIGMA}
    return evidence


def read_lines(path):
    try:
        with open(path, encoding="utf-8") as file:
            return [json.loads(line) for line in file if line.endswith("\n")]
    except (OSError, ValueError) as error:
        raise BadInput(f"{path}: {error}") from error


def is_asked(facts):
    """trust_report.to_be_answered, where the near road need not be known."""
    near = facts.get("near_road")
    return (facts.get("motion") or 0.0) >= trust_report.MOTION and (
        near is None or near >= trust_report.NEAR_ROAD_PIXELS)


def cases_of(folders, fault_weight):
    cases = []
    for folder in folders:
        facts = {line["scene"]: line for line in read_lines(folder / "scenes.jsonl")}
        entries = read_lines(folder / "runs.jsonl")
        plain = {(e["definition"]["scene"], e["definition"]["frames"]): e["result"]
                 for e in entries if e["definition"]["fault"] == "none"}
        for entry in entries:
            entry["facts"] = facts.get(entry["definition"]["scene"], {})
            if trust_report.crashed(entry) or not is_asked(entry["facts"]):
                continue
            if entry["result"]["exit_code"] == 0 and not entry["result"].get("evidence"):
                continue  # of a program without evidence
            sound = entry["definition"]["fault"] == "none"
            if sound or trust_report.contradicted(entry, plain):
                cases.append(Case(entry, 1.0 if sound else fault_weight))
    if not cases:
        raise BadInput("no runs with evidence of scenes that should be answered")
    return cases


# --- today's decisions ---------------------------------------------------------------------------

def log_student(x, sigma, freedom):
    z = x / sigma
    return (math.lgamma(0.5 * (freedom + 1)) - math.lgamma(0.5 * freedom)
            - 0.5 * math.log(freedom * math.pi) - math.log(sigma)
            - 0.5 * (freedom + 1) * math.log1p(z * z / freedom))


def today_score(case, wrong, factor, freedom):
    if not case.answered:
        return UNIFORM
    density = (1 - wrong) * math.exp(log_student(case.error, factor * case.sigma, freedom))
    return math.log(density + wrong * math.exp(UNIFORM))


def fit_today(cases):
    best = None
    for wrong in (0.001, 0.003, 0.01, 0.02, 0.04, 0.08):
        for factor in (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3):
            for freedom in (2.0, 3.0, 5.0, 8.0, 15.0, 40.0):
                score = weighted((today_score(c, wrong, factor, freedom), c) for c in cases)
                if best is None or score > best[0]:
                    best = (score, (wrong, factor, freedom))
    return best[1]


# --- the belief ----------------------------------------------------------------------------------

class Replay:
    """The program, which stays up, over the cases that have an answer."""

    def __init__(self, program, cases):
        self.cases = [c for c in cases if c.answered]
        self.file = tempfile.NamedTemporaryFile("w", suffix=".json", encoding="utf-8")
        json.dump([{"evidence": c.evidence, "truth": -c.error} for c in self.cases], self.file)
        self.file.flush()
        try:
            self.process = subprocess.Popen(
                [str(program.resolve()), self.file.name], stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, text=True)
        except OSError as error:
            raise BadInput(f"{program}: {error.strerror}") from error

    def __call__(self, parameters, step=None):
        """Of each case: log density at the truth, mode, sigma, second mass."""
        request = request_of(parameters, self.cases)
        if step:
            request["noise"]["step"] = step
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise BadInput("the program ended: see above")
        return json.loads(line)


def request_of(parameters, cases):
    request = {"noise": {}, "sources": collections.defaultdict(dict)}
    for key, value in parameters.items():
        group, name = key.split(".")
        if group == "noise":
            request["noise"][name] = value
        elif group != "layer":
            request["sources"][group][name] = value
    request["other_layer"] = [other_layer(c.layer, parameters) for c in cases]
    return request


def other_layer(measured, parameters):
    """Probability of another layer: RoadLayer::log_odds() with these coefficients."""
    if measured is None or measured.get("posed"):
        return 0.0
    p = {key[6:]: value for key, value in parameters.items() if key.startswith("layer.")}
    odds = p["base"] + p["disagreeing"] * (1 - measured["agreeing"])
    odds += sum(factor * measured[key] for key, factor in FIXED_LAYER.items())
    if measured["masked"]:
        odds += p["unfound"] * (1 - measured["found"])
        odds += {0: 0.0, 1: p["ambiguous"], 2: p["informative"]}[int(measured["search"])]
    return 1.0 / (1.0 + math.exp(-max(-40.0, min(40.0, odds))))


def to_free(value, kind):
    return {"log": math.log, "logit": lambda v: math.log(v / (1 - v)), "plain": float}[kind](value)


def from_free(value, kind):
    return {"log": math.exp, "logit": lambda v: 1 / (1 + math.exp(-v)), "plain": float}[kind](value)


def fit(replay, parameters, rounds, report):
    """Coordinate by coordinate, with steps that double while they help and halve when not.

    A weak normal prior about the start (standard deviation 1.5 of the free value, as much as two
    thirds of a case at that) keeps parameters in place that no run shows."""
    start = {key: to_free(value, START[key][1]) for key, (value, _) in START.items()}
    free = {key: to_free(parameters[key], START[key][1]) for key in START}
    count = sum(case.weight for case in replay.cases)

    def score(candidate):
        values = {key: from_free(value, START[key][1]) for key, value in candidate.items()}
        prior = sum(((candidate[key] - start[key]) / 1.5) ** 2 for key in candidate) / 3.0
        rows = replay(values, step=0.004)
        return weighted((row[0], c) for row, c in zip(rows, replay.cases)) - prior / count

    best = score(free)
    steps = {key: 0.4 for key in START}
    for number in range(rounds):
        for key in START:
            for direction in (1, -1):
                moved = False
                while True:
                    candidate = {**free, key: free[key] + direction * steps[key]}
                    tried = score(candidate)
                    if tried <= best + 1e-6:
                        break
                    free, best, moved = candidate, tried, True
                if moved:
                    break
            steps[key] *= 1.0 if moved else 0.5
        report(f"round {number + 1}: {best:.4f}")
    return {key: from_free(value, START[key][1]) for key, value in free.items()}


# --- report --------------------------------------------------------------------------------------

def weighted(values):
    """Mean of (value, case) by the cases' weights."""
    pairs = [(value, case.weight) for value, case in values]
    return sum(v * w for v, w in pairs) / sum(w for _, w in pairs)


def mean(values):
    values = list(values)
    return sum(values) / len(values) if values else None


def paired(differences):
    """Mean over scenes and its standard error, None of one; differences: {scene: [values]}."""
    means = [mean(values) for values in differences.values()]
    centre = mean(means)
    if len(means) < 2:
        return centre, None
    spread = math.sqrt(sum((m - centre) ** 2 for m in means) / (len(means) - 1))
    return centre, spread / math.sqrt(len(means))


def row_of(name, cases, believed, today):
    answered = [c for c in cases if c.answered]
    scores, old = {}, {}
    for case in cases:
        scores[id(case)] = believed[id(case)][0] if case.answered else UNIFORM
        old[id(case)] = today_score(case, *today)
    differences = collections.defaultdict(list)
    for case in cases:
        differences[case.scene].append(scores[id(case)] - old[id(case)])
    gain, error = paired(differences)
    def off(case):
        _, mode, sigma, _ = believed[id(case)]
        return abs(-case.error - mode) / sigma
    def good(case):
        if not case.answered:
            return True
        _, mode, sigma, second = believed[id(case)]
        return (sigma > WEAK_SIGMA or second > WEAK_MASS or
                abs(-case.error - mode) <= 3 * sigma)
    weak = sum(not c.answered or believed[id(c)][2] > WEAK_SIGMA or
               believed[id(c)][3] > WEAK_MASS for c in cases)
    return {
        "name": name, "cases": len(cases), "answered": len(answered),
        "today": {"score": mean(old.values()),
                  "inside_2_sigma": mean(abs(c.error) <= 2 * c.sigma for c in answered),
                  "weak_or_refused": sum(c.weak for c in cases),
                  "good": mean(c.good for c in cases)},
        "belief": {"score": mean(scores.values()),
                   "inside_2_sigma": mean(off(c) <= 2 for c in answered),
                   "weak_or_refused": weak, "good": mean(map(good, cases)),
                   "median_error": trust_report.quantile(
                       [abs(-c.error - believed[id(c)][1]) for c in answered], 0.5)},
        "median_error": trust_report.quantile([abs(c.error) for c in answered], 0.5),
        "gain": gain, "standard_error": error}


def text_of(rows):
    header = ["", "cases", "answered", "score", "belief", "gain", "+-", "in 2s", "belief",
              "unmet", "belief", "good", "belief", "median", "belief"]
    table = [[r["name"], str(r["cases"]), str(r["answered"]),
              *(f"{r[who]['score']:.3f}" for who in ("today", "belief")),
              f"{r['gain']:+.3f}", trust_report.number(r["standard_error"], 3),
              *(trust_report.percent(r[who]["inside_2_sigma"]) for who in ("today", "belief")),
              *(str(r[who]["weak_or_refused"]) for who in ("today", "belief")),
              *(trust_report.percent(r[who]["good"]) for who in ("today", "belief")),
              trust_report.percent(r["median_error"], 2),
              trust_report.percent(r["belief"]["median_error"], 2)] for r in rows]
    return "\n".join(trust_report.table(header, table))


def main(words=None):
    try:
        arguments = parse(words)
        cases = cases_of(arguments.runs, arguments.fault_weight)
        parameters = {key: value for key, (value, _) in START.items()}
        if arguments.parameters and arguments.parameters.exists():
            parameters.update(json.loads(arguments.parameters.read_text(encoding="utf-8")))
        even = [c for c in cases if c.even]
        today = fit_today(even or cases)
        if arguments.fit:
            parameters = fit(Replay(arguments.program, even), parameters, arguments.rounds,
                             lambda text: print(text, file=sys.stderr))
            if arguments.parameters:
                arguments.parameters.write_text(json.dumps(parameters, indent=1) + "\n",
                                                encoding="utf-8")
        replay = Replay(arguments.program, cases)
        believed = dict(zip(map(id, replay.cases), replay(parameters)))
        rows = []
        for half in ("even", "odd"):
            of_half = [c for c in cases if c.even == (half == "even")]
            for fault in sorted({c.fault for c in of_half}, key=lambda f: (f != "none", f)):
                chosen = [c for c in of_half if c.fault == fault]
                rows.append(row_of(f"{half}, {fault}", chosen, believed, today))
        print("today's decisions: wrong {:g}, sigma times {:g}, freedom {:g}".format(*today))
        print(text_of(rows))
        if arguments.fit:
            for key, value in parameters.items():
                print(f"  {key:34s} {START[key][0]:8g} -> {value:.4g}")
        if arguments.json:
            arguments.json.write_text(json.dumps(
                {"format": "camber-replay-scale", "version": 1, "today": today,
                 "parameters": parameters, "rows": rows}, indent=1) + "\n", encoding="utf-8")
        return 0
    except (BadInput, OSError, ValueError) as error:
        print(f"replay_scale.py: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
