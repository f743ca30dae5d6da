#!/bin/bash
# What Snakemake asks of a job of Slurm: prints success, running or failed.
found=$(scontrol show job "$1" 2>&1)
state=$(sed -n 's/^ *JobState=\([A-Z_]*\).*/\1/p' <<<"$found" | head -n 1)
case $state in
  COMPLETED) echo success ;;
  PENDING | CONFIGURING | RUNNING | COMPLETING | SUSPENDED | REQUEUED | RESIZING) echo running ;;
  # Slurm forgets jobs some minutes after their end (MinJobAge); else the controller did not answer.
  "") [[ $found == *"Invalid job id"* ]] && echo failed || echo running ;;
  *) echo failed ;;
esac
