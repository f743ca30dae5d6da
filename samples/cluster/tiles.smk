# A cloud of any size by Snakemake, here or on a cluster: a plan, one job a tile, then one index (of
# patches: one surface).
#
#   snakemake -s samples/cluster/tiles.smk --cores 4 --config list=clouds.txt out=out/plan job=ground
#
# clouds.txt has the path of a LAS, LAZ or COPC file a line. Further options of `camber tiles plan`
# go into plan_options="--tile 500", those of `camber tiles run` into run_options="...". Whatever was
# interrupted goes on where it was when this is run again. Once job=patches is joined, job=labels adds
# the patch of each point to the tiles.

import json
import os
import shlex

CAMBER = config.get("camber", "camber")
OUT = config.get("out", "out/plan")
LIST = config.get("list", "clouds.txt")
JOB = config.get("job", "ground")
PLAN_OPTIONS = config.get("plan_options", "")
RUN_OPTIONS = config.get("run_options", "")
THREADS = int(config.get("threads", 2))
# What the join writes last.
JOINED = os.path.join(OUT, JOB, "run.json" if JOB == "patches" else "index.json")
# Beside the folder: Snakemake removes what a failed job was to make, and a plan goes on with its own.
MARK = OUT.rstrip("/") + ".planned"

with open(LIST, encoding="utf-8") as lines:
    CLOUDS = [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def numbers():
    """Numbers of the tiles by their names, once there is a plan."""
    with open(os.path.join(OUT, "index.json"), encoding="utf-8") as text:
        return {tile["name"]: k for k, tile in enumerate(json.load(text)["tiles"])}


def results(wildcards):
    checkpoints.plan.get()
    return expand(os.path.join(OUT, JOB, "{name}.json"), name=numbers())


wildcard_constraints:
    name="[^/]+",


rule all:
    input:
        JOINED,


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
    output:
        os.path.join(OUT, JOB, "{name}.json"),
    threads: THREADS
    params:
        number=lambda wildcards: numbers()[wildcards.name],
        folder=shlex.quote(OUT),
    shell:
        "{CAMBER} tiles run {params.folder} --job {JOB} --tile {params.number} "
        "--threads {threads} {RUN_OPTIONS}"


rule join:
    input:
        results,
    output:
        JOINED,
    params:
        folder=shlex.quote(OUT),
    shell:
        "{CAMBER} tiles join {params.folder} --job {JOB}"
