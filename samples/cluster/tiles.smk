# A cloud of any size by Snakemake, here or on a cluster: a plan, one job a tile, then one join.
#
#   snakemake -s samples/cluster/tiles.smk --cores 4 --config list=clouds.txt out=out/plan job=ground
#   snakemake -s samples/cluster/tiles.smk --cores 4 --config list=clouds.txt out=out/plan job=profile \
#     run_options="--along line.csv" join_options="--along line.csv --crown"
#
# clouds.txt has the path of a LAS, LAZ or COPC file a line. Further options of `camber tiles plan`
# go into plan_options="--tile 500", those of `camber tiles run` and `join` into run_options="..." and
# join_options="...". Whatever was interrupted goes on where it was when this is run again. What a job
# stands on is done before: labels on patches, export and profile on ground (where --ground-from takes
# nothing else); options of that go into before_options="...".

import json
import os
import shlex

CAMBER = config.get("camber", "camber")
OUT = config.get("out", "out/plan")
LIST = config.get("list", "clouds.txt")
JOB = config.get("job", "ground")
PLAN_OPTIONS = config.get("plan_options", "")
RUN_OPTIONS = config.get("run_options", "")
JOIN_OPTIONS = config.get("join_options", "")
BEFORE_OPTIONS = config.get("before_options", "")
THREADS = int(config.get("threads", 2))
BEFORE = {"labels": "patches"}
if "--ground-from" not in RUN_OPTIONS:
    BEFORE.update({"export": "ground", "profile": "ground"})
# Beside the folder: Snakemake removes what a failed job was to make, and a plan goes on with its own.
MARK = OUT.rstrip("/") + ".planned"

with open(LIST, encoding="utf-8") as lines:
    CLOUDS = [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def joined(job):
    """What the join of a job writes last."""
    return os.path.join(OUT, job, "run.json" if job == "patches" else "index.json")


def numbers():
    """Numbers of the tiles by their names, once there is a plan."""
    with open(os.path.join(OUT, "index.json"), encoding="utf-8") as text:
        return {tile["name"]: k for k, tile in enumerate(json.load(text)["tiles"])}


def results(job):
    """The tiles of a job."""
    def of_plan(wildcards):
        checkpoints.plan.get()
        return expand(os.path.join(OUT, job or wildcards.job, "{name}.json"), name=numbers())
    return of_plan


def before(wildcards):
    """What a job stands on."""
    return [joined(BEFORE[wildcards.job])] if wildcards.job in BEFORE else []


def run_options(wildcards):
    return RUN_OPTIONS if wildcards.job == JOB else BEFORE_OPTIONS


def join_options(job):
    return JOIN_OPTIONS if job == JOB else ""


wildcard_constraints:
    job="[a-z]+",
    name=r"(?!(?:index|run)\.json$)[^/]+",


rule all:
    input:
        joined(JOB),


checkpoint plan:
    input:
        CLOUDS,
    output:
        touch(MARK),
    threads: THREADS
    params:
        clouds=" ".join(shlex.quote(cloud) for cloud in CLOUDS),
        folder=shlex.quote(OUT),
    shell:
        "{CAMBER} tiles plan {params.clouds} --out {params.folder} --threads {threads} "
        "{PLAN_OPTIONS}"


rule tile:
    input:
        MARK,
        before,
    output:
        os.path.join(OUT, "{job}", "{name}.json"),
    threads: THREADS
    params:
        number=lambda wildcards: numbers()[wildcards.name],
        folder=shlex.quote(OUT),
        options=run_options,
    shell:
        "{CAMBER} tiles run {params.folder} --job {wildcards.job} --tile {params.number} "
        "--threads {threads} {params.options}"


rule join:
    input:
        results(None),
    output:
        os.path.join(OUT, "{job}", "index.json"),
    params:
        folder=shlex.quote(OUT),
        options=lambda wildcards: join_options(wildcards.job),
    shell:
        "{CAMBER} tiles join {params.folder} --job {wildcards.job} {params.options}"


# One surface: another last file.
rule join_patches:
    input:
        results("patches"),
    output:
        os.path.join(OUT, "patches", "run.json"),
    params:
        folder=shlex.quote(OUT),
        options=join_options("patches"),
    shell:
        "{CAMBER} tiles join {params.folder} --job patches {params.options}"
