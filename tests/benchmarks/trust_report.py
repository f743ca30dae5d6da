"""What the runs of trust.py show: shares, quantiles, the worst, and the faults."""

import collections
import math
import re

from benchmark_json import column, document

VEHICLE_COLUMNS = ("distance", "center_error", "center_mahalanobis", "height_error", "height_sigma",
                   "frame", "along_error", "along_sigma")
CENTER_LIMIT = 7.815   # 95 % of chi squared, three degrees of freedom
HEIGHT_LIMIT = 1.96    # 95 % of a normal, in sigma
WORST = 10
TURN_DEG = 2.0         # between the outer frames: a turn
MOTION = 0.1           # camera heights a frame } at least so much: a scene that is to be answered
NEAR_ROAD_PIXELS = 1500  #                      }


def report_of(entries, options, program):
    plain = [e for e in entries if e["definition"]["fault"] == "none"]
    rows = []
    for frames in options["frames"]:
        rows.append(row_of(frames, [e for e in plain if e["definition"]["frames"] == frames]))
    if len(rows) > 1:
        rows.append(row_of("all", plain))
    for name, kind in (("straight", False), ("turning", True)):
        rows.append(row_of(name, [e for e in plain if turns(e["facts"]) == kind]))
    faulty = [fault for fault in options["faults"] if fault != "none"]
    of_fault = {fault: [e for e in entries if e["definition"]["fault"] == fault]
                for fault in faulty}
    results = {(e["definition"]["scene"], e["definition"]["frames"]): e["result"] for e in plain}
    return {
        "format": "camber-trust", "version": 1, "program": program,
        "options": {key: str(value) if hasattr(value, "parts") else value
                    for key, value in options.items()},
        "rows": [row for row in rows if row["runs"]],
        "refusals": refusals(plain), "warnings": warnings(plain),
        "unanswered": [summary(e) for e in plain
                       if e["result"]["exit_code"] != 0 or e["result"]["status"] != "ok"],
        "worst_by_z": [summary(e) for e in worst(plain, z_of)],
        "worst_by_error": [summary(e) for e in worst(plain, lambda e: abs(e["result"]["error"]))],
        "faults": [fault_row(fault, found, results) for fault, found in of_fault.items()],
        "crashed": [summary(e) for e in entries if crashed(e)],
    }


# --- one run -------------------------------------------------------------------------------------

def crashed(entry):
    """The command ended neither with an answer nor with a sentence about its input."""
    return entry["result"]["exit_code"] not in (0, 1, 2)


def refused(entry):
    return entry["result"]["exit_code"] in (1, 2)


def has_error(entry):
    result = entry["result"]
    return result["exit_code"] == 0 and result["error"] is not None and result["sigma"] is not None


def z_of(entry):
    return abs(entry["result"]["error"]) / max(entry["result"]["sigma"], 1e-12)


def turns(known):
    """A scene by its facts, or a run by its result: the frames that were used."""
    return (known.get("turn_deg") or 0.0) >= TURN_DEG


def to_be_answered(entry):
    """A scene that moves, and shows road near the camera."""
    facts = entry["facts"]
    return (facts.get("motion") or 0.0) >= MOTION and (
        facts.get("near_road") or 0) >= NEAR_ROAD_PIXELS


def contradicted(entry, plain):
    """Whether something in the images contradicts the fault; plain: the results without a fault.

    Frames, poses and images: always; height: markings of known size or three cars nearer than
    30 m; calibration: dashes (their length and their line's width), three such cars seen
    obliquely, or a turn. Markings are those that this run saw or the one without the fault: the
    truth does not tell which were in view."""
    definition, facts = entry["definition"], entry["facts"]
    results = [entry["result"], plain.get((definition["scene"], definition["frames"]), {})]
    if definition["fault"].startswith("height"):
        return facts.get("cars", 0) >= 3 or any(r.get("markings_seen") for r in results)
    if definition["fault"].startswith(("focal", "fov")) or definition["fault"] == "cx0":
        return (facts.get("oblique", 0) >= 3 or any(map(turns, results)) or
                any(r.get("dashes") for r in results))
    return True


def summary(entry):
    """A run in the lists."""
    definition, result = entry["definition"], entry["result"]
    out = {"key": entry["key"], "scene": definition["scene"], "number": entry["number"],
           "frames": definition["frames"], "fault": definition["fault"]}
    if result["exit_code"] != 0:
        return {**out, "exit_code": result["exit_code"], "reason": result["reason"]}
    out.update(error=result["error"], sigma=result["sigma"], status=result["status"],
               used_frames=result["used_frames"], turn_deg=result["turn_deg"],
               motion=entry["facts"].get("motion"), warnings=result["warnings"])
    if has_error(entry):
        out["z"] = z_of(entry)
    return out


# --- all runs ------------------------------------------------------------------------------------

def quantile(values, share):
    """Linear between the sorted values; None without any."""
    if not values:
        return None
    values = sorted(values)
    at = share * (len(values) - 1)
    low = math.floor(at)
    return values[low] + (at - low) * (values[min(low + 1, len(values) - 1)] - values[low])


def share(flags):
    flags = list(flags)
    return sum(flags) / len(flags) if flags else None


def row_of(name, entries):
    answered = [e for e in entries if e["result"]["exit_code"] == 0]
    known = [e for e in answered if has_error(e)]
    errors = [abs(e["result"]["error"]) for e in known]
    sigmas = [e["result"]["sigma"] for e in known]
    z = [z_of(e) for e in known]
    asked = [e for e in entries if to_be_answered(e)]
    return {
        "name": name, "runs": len(entries), "refused": sum(map(refused, entries)),
        "crashed": sum(map(crashed, entries)), "without_truth": len(answered) - len(known),
        "weak": sum(e["result"]["status"] != "ok" for e in answered),
        "warned": sum(bool(e["result"]["warnings"]) for e in answered),
        "to_be_answered": len(asked),
        "weak_or_refused_of_these": sum(
            e["result"]["exit_code"] != 0 or e["result"]["status"] != "ok" for e in asked),
        "error": {"median": quantile(errors, 0.5), "p90": quantile(errors, 0.9),
                  "worst": max(errors, default=None)},
        "sigma": {"median": quantile(sigmas, 0.5), "p90": quantile(sigmas, 0.9)},
        "inside_2_sigma": share(x <= 2.0 for x in z), "inside_3_sigma": share(x <= 3.0 for x in z),
        "beyond_4_sigma": sum(x > 4.0 for x in z), "largest_z": max(z, default=None),
        "vehicles": vehicles_of(answered),
    }


def vehicles_of(entries):
    cars = [car for e in entries for car in cars_of(e)]
    errors = [car["center_error"] for car in cars if car["center_error"] is not None]
    return {
        "count": len(errors),
        "mean": sum(errors) / len(errors) if errors else None, "median": quantile(errors, 0.5),
        "centers_inside_95": share(car["center_mahalanobis"] < CENTER_LIMIT for car in cars
                                   if car["center_mahalanobis"] is not None),
        "heights_inside_95": share(abs(car["height_error"]) < HEIGHT_LIMIT * car["height_sigma"]
                                   for car in cars
                                   if car["height_error"] is not None and car["height_sigma"]),
    }


def cars_of(entry):
    return [dict(zip(VEHICLE_COLUMNS, car)) for car in entry["result"].get("vehicles", [])]


def nearest_car(entry):
    """Of the middle one of the frames that were used; None: none with a stated distance."""
    used = entry["result"].get("used_frames", [])
    cars = [car for car in cars_of(entry) if used and car.get("frame") == used[len(used) // 2] and
            car["along_error"] is not None and car["along_sigma"]]
    return min(cars, key=lambda car: car["distance"], default=None)


def nearest_cars_of(entries):
    """What is stated of the distance of each run's nearest car, and how far that is off."""
    cars = list(filter(None, map(nearest_car, entries)))
    return {"count": len(cars),
            "error": quantile([abs(c["along_error"]) / c["distance"] for c in cars], 0.5),
            "sigma": quantile([c["along_sigma"] / c["distance"] for c in cars], 0.5),
            "inside_2_sigma": share(abs(c["along_error"]) <= 2.0 * c["along_sigma"] for c in cars)}


def refusals(entries):
    """Counts by reason, numbers left out of them."""
    counts = collections.Counter(re.sub(r"\d+(\.\d+)?", "#", e["result"]["reason"])
                                 for e in entries if e["result"]["exit_code"] != 0)
    return dict(counts.most_common())


def warnings(entries):
    """Runs with each kind of warning: its code, and what stands before a colon in it."""
    kinds = collections.Counter()
    for entry in entries:
        kinds.update({": ".join([code, *re.findall(r"^\w+(?=:)", text)])
                      for code, text in entry["result"].get("warnings", [])})
    return dict(kinds.most_common())


def worst(entries, measure):
    return sorted(filter(has_error, entries), key=measure, reverse=True)[:WORST]


def worst_entries(entries):
    """The worst by both measures and the faults that went wrong, each once."""
    plain = [e for e in entries if e["definition"]["fault"] == "none"]
    chosen = worst(plain, z_of) + worst(plain, lambda e: abs(e["result"]["error"]))
    chosen += worst([e for e in entries if verdict_of(e) == "wrong"], z_of)
    return list({e["key"]: e for e in chosen}.values())


def verdict_of(entry):
    """Of a run with a fault."""
    if entry["definition"]["fault"] == "none":
        return "no fault"
    if crashed(entry):
        return "crashed"
    if refused(entry):
        return "refused"
    if entry["result"]["warnings"]:
        return "warned"
    if not has_error(entry):
        return "without_truth"
    return "inside_3_sigma" if z_of(entry) <= 3.0 else "wrong"


def fault_row(fault, entries, plain):
    counts = collections.Counter(map(verdict_of, entries))
    judged = [e for e in entries if verdict_of(e) not in ("crashed", "without_truth")]
    seen = [e for e in judged if contradicted(e, plain)]
    return {
        "fault": fault, "runs": len(entries),
        **{key: counts[key] for key in ("refused", "warned", "inside_3_sigma", "wrong", "crashed",
                                        "without_truth")},
        "inside_2_sigma": share(z_of(e) <= 2.0 for e in filter(has_error, entries)),
        "sigma": quantile([e["result"]["sigma"] for e in filter(has_error, entries)], 0.5),
        "nearest_cars": nearest_cars_of(entries),
        "contradicted": len(seen),
        "good_of_these": share(verdict_of(e) != "wrong" for e in seen),
        "listed": [{**summary(e), "contradicted": contradicted(e, plain)}
                   for e in sorted(filter(has_error, entries), key=z_of, reverse=True)
                   if verdict_of(e) == "wrong"],
    }


# --- the page of results ---------------------------------------------------------------------------

def document_of(report, program, command, load_before):
    """The tables of make_benchmark_md.py: of the faults alone where there are any. The sound runs
    among them only serve to compare; sound runs of their own have a file of their own."""
    share_of = lambda value: None if value is None else 100.0 * value
    scale = {"key": "trust.scale", "name": "Scales and what is stated of them", "command": command,
             "columns": [column("frames", label=True), column("runs"),
                         column("refused", better="lower"), column("weak", better="lower"),
                         *(column(name, "%", better="lower") for name in (
                             "error, median", "error, 90 %", "error, worst", "sigma, median",
                             "sigma, 90 %")),
                         column("inside 2 sigma", "%"), column("beyond 4 sigma", better="lower"),
                         column("largest z", better="lower")],
             "rows": [[r["name"], r["runs"], r["refused"], r["weak"],
                       *(share_of(r["error"][key]) for key in ("median", "p90", "worst")),
                       *(share_of(r["sigma"][key]) for key in ("median", "p90")),
                       share_of(r["inside_2_sigma"]), r["beyond_4_sigma"], r["largest_z"]]
                      for r in report["rows"]]}
    vehicles = {"key": "trust.vehicles", "name": "Vehicles of all frames", "command": command,
                "columns": [column("frames", label=True), column("vehicles"),
                            column("centre error, mean", "m", better="lower"),
                            column("centre error, median", "m", better="lower"),
                            column("centres inside their 95 %", "%"),
                            column("heights inside their 95 %", "%")],
                "rows": [[r["name"], v["count"], v["mean"], v["median"],
                          share_of(v["centers_inside_95"]), share_of(v["heights_inside_95"])]
                         for r in report["rows"] for v in [r["vehicles"]] if v["count"]]}
    counts = ("runs", "refused", "warned", "inside_3_sigma", "wrong", "contradicted")
    faults = {"key": "trust.faults", "name": "Faults put into what is given", "command": command,
              "columns": [column("fault", label=True),
                          *(column(key.replace("_", " ")) for key in counts),
                          column("good of those contradicted", "%", better="higher")],
              "rows": [[r["fault"], *(r[key] for key in counts), share_of(r["good_of_these"])]
                       for r in report["faults"]]}
    tables = [faults] if faults["rows"] else [table for table in (scale, vehicles) if table["rows"]]
    return document(program, load_before, tables, report["options"]["seed"])


# --- text ----------------------------------------------------------------------------------------

def percent(value, digits=1):
    return "-" if value is None else f"{100.0 * value:.{digits}f}"


def number(value, digits=2):
    return "-" if value is None else f"{value:.{digits}f}"


def table(header, rows):
    cells = [header, *rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    return ["  ".join(cell.ljust(w) if i == 0 else cell.rjust(w)
                      for i, (cell, w) in enumerate(zip(row, widths))).rstrip() for row in cells]


def text_of(report):
    lines = [f"program {report['program']}", "",
             "scale, without a fault (error: 100 times the logarithm of estimated over true; "
             "sigma in %)"]
    lines += table(
        ["frames", "runs", "refused", "weak", "warned", "unmet", "median", "90 %", "worst", "sigma",
         "90 %", "in 2s", "in 3s", ">4s", "max z"],
        [[r["name"], str(r["runs"]), str(r["refused"]), str(r["weak"]), str(r["warned"]),
          f"{r['weak_or_refused_of_these']}/{r['to_be_answered']}",
          *(percent(r["error"][key], 2) for key in ("median", "p90", "worst")),
          percent(r["sigma"]["median"], 2), percent(r["sigma"]["p90"], 2),
          percent(r["inside_2_sigma"]), percent(r["inside_3_sigma"]), str(r["beyond_4_sigma"]),
          number(r["largest_z"])] for r in report["rows"]])
    lines += ["unmet: weak or refused of the scenes that move and show near road", "",
              "vehicles of all frames (centre error in m; inside 95 % in %)"]
    lines += table(
        ["frames", "cars", "mean", "median", "centres", "heights"],
        [[r["name"], str(v["count"]), number(v["mean"], 3), number(v["median"], 3),
          percent(v["centers_inside_95"]), percent(v["heights_inside_95"])]
         for r in report["rows"] for v in [r["vehicles"]]])
    for title, counts in (("refusals", report["refusals"]), ("warnings", report["warnings"])):
        lines += ["", title, *(f"{count:4d}  {text}" for text, count in counts.items())]
    lines += ["", "refused or weak", *(
        f"  {e['scene']} {e['frames']}: " + (e["status"] if "status" in e else "refused")
        for e in report["unanswered"])]
    for title, key in (("worst by z", "worst_by_z"), ("worst by error", "worst_by_error")):
        lines += ["", title, *map(line_of, report[key])]
    if report["faults"]:
        lines += ["", "faults (good: refused, warned of or inside 3 sigma, % of the contradicted)"]
        lines += table(
            ["fault", "runs", "refused", "warned", "in 3s", "wrong", "contradicted", "good"],
            [[r["fault"], str(r["runs"]), str(r["refused"]), str(r["warned"]),
              str(r["inside_3_sigma"]), str(r["wrong"]), str(r["contradicted"]),
              percent(r["good_of_these"])] for r in report["faults"]])
        lines += ["", "the same, scale and nearest car (sigma: median stated, %)"]
        lines += table(
            ["fault", "scale in 2s", "sigma", "cars", "in 2s", "error", "sigma"],
            [[r["fault"], percent(r["inside_2_sigma"]), percent(r["sigma"]), str(c["count"]),
              percent(c["inside_2_sigma"]), percent(c["error"]), percent(c["sigma"])]
             for r in report["faults"] for c in [r["nearest_cars"]]])
        for row in report["faults"]:
            lines += [line_of(e) + ("" if e["contradicted"] else " (nothing contradicts it)")
                      for e in row["listed"]]
    if report["crashed"]:
        lines += ["", "crashed", *(f"  {e['scene']} {e['frames']} {e['fault']}: exit code "
                                   f"{e['exit_code']}, {e['reason']}" for e in report["crashed"])]
    return "\n".join(lines)


def line_of(entry):
    """One answered run of a list."""
    fault = "" if entry["fault"] == "none" else f" {entry['fault']}"
    used = "" if entry["frames"] != "none" else " ({})".format(
        " ".join(map(str, entry["used_frames"])))
    words = "; ".join(text for _, text in entry["warnings"])
    if len(words) > 100:
        words = words[:97] + "..."
    error = 100 * math.expm1(entry["error"])
    return (f"  {entry['scene']} {entry['frames']}{used}{fault}: error {error:+.2f} "
            f"sigma {100 * entry['sigma']:.2f} % z {entry['z']:.1f} {entry['status']}"
            f", {number(entry['motion'])} heights a frame, turn {number(entry['turn_deg'], 1)} deg"
            + (f" [{words}]" if words else ""))
