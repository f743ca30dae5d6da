#!/usr/bin/env bash
# A Slurm cluster of this machine alone, with its own munge, ports and files; no accounting.
#   one_node_slurm.sh start FOLDER   prints why and exits with 77 where it cannot be started here
#   one_node_slurm.sh stop FOLDER
# What uses it takes SLURM_CONF=FOLDER/slurm.conf.
set -euo pipefail
PATH=$PATH:/usr/sbin:/sbin
action=${1:?start or stop} folder=$(realpath -m "${2:?FOLDER}")

stop() {
  local name pid
  for name in slurmd slurmctld munged; do
    pid=$(cat "$folder/$name.pid" 2>/dev/null || cat "$folder/munge/$name.pid" 2>/dev/null) || continue
    kill "$pid" 2>/dev/null || continue
    for _ in $(seq 100); do
      kill -0 "$pid" 2>/dev/null || break
      sleep 0.1
    done
    kill -9 "$pid" 2>/dev/null || true
  done
}
skip() {
  stop
  printf 'Slurm cannot be started here: %s\n' "$1"
  exit 77
}

if [ "$action" = stop ]; then
  export SLURM_CONF=$folder/slurm.conf
  timeout 10 scancel --user=root >/dev/null 2>&1 || true
  stop
  exit 0
fi

for program in munged slurmctld slurmd sbatch setpriv; do
  command -v $program >/dev/null ||
    skip "no $program (apt-get install --no-install-recommends slurm-wlm munge)"
done
[ "$(id -u)" -eq 0 ] || skip "only root may"
id munge >/dev/null 2>&1 || skip "no user munge"

# A port that nobody listens on.
free_port() {
  local port
  for _ in $(seq 100); do
    port=$((20000 + RANDOM % 10000))
    (: <"/dev/tcp/127.0.0.1/$port") 2>/dev/null || break
  done
  echo $port
}
mkdir -p "$folder/munge" "$folder/state" "$folder/spool"
head -c 1024 /dev/urandom >"$folder/munge/key"
chown -R munge:munge "$folder/munge"
chmod 400 "$folder/munge/key"
chmod 755 "$folder/munge"
host=$(hostname -s)
# More processors than there are: tasks run at the same time on any machine.
cat >"$folder/slurm.conf" <<END
ClusterName=camber
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
AuthType=auth/munge
AuthInfo=socket=$folder/munge/socket,cred_expire=5
SlurmUser=root
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
SlurmdParameters=config_overrides
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
MailProg=/bin/true
MpiDefault=none
ReturnToService=2
SchedulerParameters=sched_interval=1,bf_interval=1
NodeName=$host NodeAddr=127.0.0.1 CPUs=8 Boards=1 SocketsPerBoard=1 CoresPerSocket=8 ThreadsPerCore=1 RealMemory=32000 State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
END
echo CgroupPlugin=cgroup/v1 >"$folder/cgroup.conf"
export SLURM_CONF=$folder/slurm.conf
cd "$folder"
setpriv --reuid munge --regid munge --clear-groups munged --key-file="$folder/munge/key" \
  --socket="$folder/munge/socket" --pid-file="$folder/munge/munged.pid" \
  --log-file="$folder/munge/log" --seed-file="$folder/munge/seed" >"$folder/out" 2>&1 ||
  skip "munged: $(tail -n 1 "$folder/out")"
slurmctld -c >"$folder/out" 2>&1 || skip "slurmctld: $(tail -n 1 "$folder/out")"
slurmd >"$folder/out" 2>&1 || skip "slurmd: $(tail -n 1 "$folder/out")"
for _ in $(seq 150); do
  state=$(sinfo -h -o %T 2>/dev/null || true)
  [ "$state" = idle ] && exit 0
  sleep 0.2
done
skip "after 30 seconds its node is '$state'"
