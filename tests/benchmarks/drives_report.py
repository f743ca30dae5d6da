"""What the runs of drives.py show: trajectories, the road along them, vehicles."""

import math

from benchmark_json import column, document
from trust_report import CENTER_LIMIT, number, percent, quantile, share, table

VEHICLE_COLUMNS = ("frame", "truth_id", "distance", "center_error", "center_mahalanobis",
                   "along_error")
DISTANCES = (("all", 0.0, math.inf), ("<= 15 m", 0.0, 15.0), ("15 to 30 m", 15.0, 30.0),
             ("> 30 m", 30.0, math.inf))
CLOSE_LENGTH = 0.01  # relative error of a drive's length


def report_of(entries, program, seed):
    wholes = [e for e in entries if e["definition"]["frames"] == "none"]
    answered = [e for e in wholes if e["result"]["exit_code"] == 0]
    frames = [e for e in entries if e["definition"]["frames"] != "none"]
    return {
        "format": "camber-drives", "version": 1, "program": program, "seed": seed,
        "drives": [drive_row(e) for e in answered],
        "summary": summary_of(answered) if answered else [],
        "vehicles": vehicle_rows(answered, frames),
        "refused": [listed(e) for e in wholes if e["result"]["exit_code"] in (1, 2)],
        "crashed": [listed(e) for e in entries if e["result"]["exit_code"] not in (0, 1, 2)],
    }


def listed(entry):
    definition, result = entry["definition"], entry["result"]
    return {"scene": definition["scene"], "frames": definition["frames"],
            "exit_code": result["exit_code"], "reason": result["reason"]}


# --- one drive -----------------------------------------------------------------------------------

def kitti_of(trajectory):
    """KITTI's measure at half the length of a short drive, else at its own lengths."""
    errors = trajectory["kitti_every_frame"]
    return errors["half"] or errors


def drive_row(entry):
    result = entry["result"]
    t, road, tracks = result["trajectory"], result["road"] or {}, result["tracks"] or {}
    windows, kitti = t["windows"], kitti_of(t)
    part = lambda key, name: (road.get(key) or {}).get(name)
    return {
        "scene": entry["definition"]["scene"], "number": entry["number"],
        "length": t["true_length"], "error": t["length_log_error"],
        "z": t.get("length_error_sigma"),
        "sigma": t["length_sigma"], "windows": windows["count"],
        "windows_close": windows["within_2_percent"], "windows_p95": windows["p95_abs_log_error"],
        "windows_inside": windows["within_2_sigma"], "own_spread": windows["own_spread"],
        "translation_percent": kitti["translation_percent"],
        "rotation_deg": kitti["rotation_deg_per_100m"], "posed": t["share_with_pose"],
        "cells": road.get("cells", 0), "cells_answered": road.get("share_answered"),
        "height_median": part("height_error", "median"), "height_p95": part("height_error", "p95"),
        "joined_median": part("height_error_joined", "median"),
        "joined_p95": part("height_error_joined", "p95"),
        "beside_p95": part("height_error_beside", "p95"),
        "beside_inside": part("height_error_beside", "within_95"),
        "grade_rms": part("grade_error_deg", "rms"),
        "frame_grade_rms": part("frame_grade_error_deg", "rms"),
        "frame_grade_inside": part("frame_grade_error_deg", "within_95"),
        "id_switches": tracks.get("id_switches"), "fragmentations": tracks.get("fragmentations"),
        "split": tracks.get("split"), "vehicle_frames": tracks.get("true_vehicles"),
        "vehicles_inside": inside(result["vehicles"]), "warnings": result["warnings"],
    }


def inside(vehicles):
    """Share of the centres inside their 95 %."""
    return share(v[4] <= CENTER_LIMIT for v in vehicles if v[4] is not None)


# --- all drives ----------------------------------------------------------------------------------

def mean(values, weights=None):
    pairs = [(v, w) for v, w in zip(values, weights or [1.0] * len(values)) if v is not None]
    total = sum(w for _, w in pairs)
    return sum(v * w for v, w in pairs) / total if total else None


def rms(values, weights=None):
    squared = mean([None if v is None else v * v for v in values], weights)
    return None if squared is None else math.sqrt(squared)


def summary_of(entries):
    """[measure, value, the worst drive's, better]."""
    rows = [drive_row(e) for e in entries]
    of = lambda key: [row[key] for row in rows]
    known = lambda key: [v for v in of(key) if v is not None]
    least = lambda key: min(known(key), default=None)
    most = lambda key: max(known(key), default=None)
    windows, cells = of("windows"), of("cells")
    hundred = lambda value: None if value is None else 100.0 * value
    errors = [abs(v) for v in known("error")]
    frames = sum(v for v in of("vehicle_frames") if v)
    switches = sum(v for v in of("id_switches") if v)
    return [
        ["drives", len(rows), None],
        ["length within 1 %, %", hundred(share(e <= CLOSE_LENGTH for e in errors)), None],
        ["length error, %", hundred(mean(errors)), hundred(max(errors, default=None))],
        ["length inside 2 sigma, %", hundred(share(abs(z) <= 2.0 for z in known("z"))), None],
        ["windows within 2 %, %", hundred(mean(of("windows_close"), windows)),
         hundred(least("windows_close"))],
        ["windows inside 2 sigma, %", hundred(mean(of("windows_inside"), windows)),
         hundred(least("windows_inside"))],
        ["windows, spread over own part", rms(of("own_spread"), windows), most("own_spread")],
        ["translation, % a 100 m", mean(of("translation_percent")), most("translation_percent")],
        ["rotation, deg a 100 m", mean(of("rotation_deg")), most("rotation_deg")],
        ["frames with a pose, %", hundred(mean(of("posed"))), hundred(least("posed"))],
        ["cells answered, %", hundred(mean(of("cells_answered"), cells)),
         hundred(least("cells_answered"))],
        ["height, median, m", mean(of("height_median"), cells), most("height_median")],
        ["height, 95 %, m", mean(of("height_p95"), cells), most("height_p95")],
        ["height, joined, median, m", mean(of("joined_median"), cells), most("joined_median")],
        ["height, joined, 95 %, m", mean(of("joined_p95"), cells), most("joined_p95")],
        ["height beside the line, 95 %, m", mean(of("beside_p95"), cells), most("beside_p95")],
        ["bands of heights that hold, %", hundred(mean(of("beside_inside"), cells)),
         hundred(least("beside_inside"))],
        ["grade of the road, rms, deg", rms(of("grade_rms")), most("grade_rms")],
        ["grade of frames, rms, deg", rms(of("frame_grade_rms")), most("frame_grade_rms")],
        ["bands of grades that hold, %", hundred(mean(of("frame_grade_inside"))),
         hundred(least("frame_grade_inside"))],
        ["vehicle frames", frames, None], ["id switches", switches, most("id_switches")],
        ["fragmentations", sum(v for v in of("fragmentations") if v), most("fragmentations")],
        ["vehicles split", sum(v for v in of("split") if v), most("split")],
        ["centres inside their 95 %, all frames, %",
         hundred(inside([v for e in entries for v in e["result"]["vehicles"]])),
         hundred(least("vehicles_inside"))],
    ]


def vehicle_rows(wholes, frames):
    """Vehicles that both the drive and reconstruct placed, by distance."""
    of_drive = {(e["definition"]["scene"], int(v[0]), int(v[1])): v
                for e in wholes for v in e["result"]["vehicles"] if v[3] is not None}
    of_frame = {(e["definition"]["scene"], v[0], v[1]): v
                for e in frames if e["result"]["exit_code"] == 0
                for v in e["result"]["vehicles"] if v[3] is not None}
    rows = []
    for name, low, high in DISTANCES:
        pairs = [(of_frame[key], of_drive[key]) for key in of_frame
                 if key in of_drive and low < of_frame[key][2] <= high]
        if not pairs:
            continue
        errors = [[pair[k][3] for pair in pairs] for k in (0, 1)]
        along = [pair[1][5] / pair[1][2] for pair in pairs if pair[1][5] is not None]
        rows.append({
            "distance": name, "vehicles": len(pairs),
            "only_drive": sum(low < v[2] <= high and k not in of_frame and
                              any(k[:2] == other[:2] for other in of_frame)
                              for k, v in of_drive.items()),
            "only_frame": sum(low < v[2] <= high and k not in of_drive
                              for k, v in of_frame.items()),
            "frame_mean": mean(errors[0]), "frame_median": quantile(errors[0], 0.5),
            "drive_mean": mean(errors[1]), "drive_median": quantile(errors[1], 0.5),
            "too_far": quantile(along, 0.5),
            "frame_inside": inside([pair[0] for pair in pairs]),
            "drive_inside": inside([pair[1] for pair in pairs])})
    return rows


# --- the page of results and text ----------------------------------------------------------------

def document_of(report, program, command, load_before):
    hundred = lambda value: None if value is None else 100.0 * value
    summary = {"key": "drives.summary", "name": "Whole drives", "command": command,
               "columns": [column("measure", label=True), column("value"),
                           column("worst drive")], "rows": report["summary"]}
    errors = [column(f"{of}, {what}", "m", better="lower")
              for of in ("reconstruct", "drive") for what in ("mean", "median")]
    vehicles = {"key": "drives.vehicles", "name": "Vehicles of whole drives", "command": command,
                "columns": [column("distance", label=True), column("vehicles"), *errors,
                            column("inside their 95 %", "%")],
                "rows": [[r["distance"], r["vehicles"], r["frame_mean"], r["frame_median"],
                          r["drive_mean"], r["drive_median"], hundred(r["drive_inside"])]
                         for r in report["vehicles"]]}
    return document(program, load_before, [t for t in (summary, vehicles) if t["rows"]],
                    report["seed"])


def text_of(report):
    lines = [f"program {report['program']}", "", "trajectories (error: 100 times the logarithm)"]
    lines += table(
        ["drive", "m", "error", "sigma", "z", "windows", "95 %", "in 2 %", "in 2s", "spread",
         "% / 100 m", "deg / 100 m", "posed"],
        [[r["scene"], number(r["length"], 1), percent(r["error"], 2), percent(r["sigma"], 2),
          number(r["z"]), str(r["windows"]), percent(r["windows_p95"], 2),
          percent(r["windows_close"]), percent(r["windows_inside"]), number(r["own_spread"]),
          number(r["translation_percent"]), number(r["rotation_deg"]), percent(r["posed"])]
         for r in report["drives"]])
    lines += ["", "road (heights in m, grades in degrees)"]
    lines += table(
        ["drive", "cells", "answered", "median", "95 %", "joined", "95 %", "beside 95 %", "held",
         "grade", "of frames", "held"],
        [[r["scene"], str(r["cells"]), percent(r["cells_answered"]),
          *(number(r[key], 3) for key in ("height_median", "height_p95", "joined_median",
                                          "joined_p95", "beside_p95")),
          percent(r["beside_inside"]), number(r["grade_rms"], 3), number(r["frame_grade_rms"], 3),
          percent(r["frame_grade_inside"])] for r in report["drives"]])
    lines += ["", "tracks"]
    lines += table(["drive", "vehicle frames", "switches", "fragmentations", "split", "in 95 %"],
                   [[r["scene"], *(str(r[key]) for key in ("vehicle_frames", "id_switches",
                                                           "fragmentations", "split")),
                     percent(r["vehicles_inside"])] for r in report["drives"]])
    lines += ["", "vehicles by both (centre errors in m; too far: median along the ray, %)"]
    lines += table(
        ["distance", "vehicles", "reconstruct", "median", "in 95 %", "drive", "median", "in 95 %",
         "too far", "one alone: drive", "reconstruct"],
        [[r["distance"], str(r["vehicles"]), number(r["frame_mean"]), number(r["frame_median"]),
          percent(r["frame_inside"]), number(r["drive_mean"]), number(r["drive_median"]),
          percent(r["drive_inside"]), percent(r["too_far"], 2), str(r["only_drive"]),
          str(r["only_frame"])] for r in report["vehicles"]])
    lines += ["", "all"]
    lines += table(["measure", "value", "worst drive"],
                   [[name, number(value, 3), number(worst, 3)]
                    for name, value, worst in report["summary"]])
    for title in ("refused", "crashed"):
        if report[title]:
            lines += ["", title, *(f"  {e['scene']} {e['frames']}: exit code {e['exit_code']}, "
                                   f"{e['reason']}" for e in report[title])]
    return "\n".join(lines)
