//! The files that the daemons read.

use std::fs;
use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;

use anyhow::{Result, bail};

/// The first version that can do without control groups, which a container may not have.
const WITHOUT_CGROUPS: (u32, u32) = (23, 2);

/// Writes them for the version of SLURM that `slurmd -V` says.
///
/// # Errors
/// If a file cannot be written, or no version was said.
pub fn write(folder: &Path, said: &str) -> Result<()> {
    for name in ["state", "spool"] {
        fs::create_dir(folder.join(name))?;
    }
    fs::write(folder.join("slurm.conf"), configuration(folder)?)?;
    // What the node has for a GPU is a device that everybody has.
    fs::write(folder.join("gres.conf"), "AutoDetect=off\nName=gpu File=/dev/null\n")?;
    // Older versions know no `disabled`; they touch the groups of version 1 only if a task is to be put there.
    let plugin = if version(said)? < WITHOUT_CGROUPS { "cgroup/v1" } else { "disabled" };
    Ok(fs::write(folder.join("cgroup.conf"), format!("CgroupPlugin={plugin}\n"))?)
}

/// `(22, 5)` of `slurm-wlm 22.05.8`.
fn version(said: &str) -> Result<(u32, u32)> {
    let mut numbers = said.split_whitespace().last().unwrap_or_default().split('.').map(str::parse);
    match (numbers.next(), numbers.next()) {
        (Some(Ok(year)), Some(Ok(month))) => Ok((year, month)),
        _ => bail!("no version of SLURM in `{said}`"),
    }
}

/// `slurm.conf`. What is not named is as SLURM has it by itself.
fn configuration(folder: &Path) -> Result<String> {
    let host = fs::read_to_string("/proc/sys/kernel/hostname")?;
    let host = host.trim().split('.').next().unwrap_or_default();
    // Both are held until both are known, or they could be the same.
    let listeners = [TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?, TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?];
    let [queue_port, node_port] = [listeners[0].local_addr()?.port(), listeners[1].local_addr()?.port()];
    let folder = folder.display();
    // `config_overrides`: the node may claim more than there is, so that no task waits for what it asked.
    // `cred_expire`: a task that is to start again waits this many seconds, by itself two minutes.
    // `KillWait`: a task that is cancelled gets this many seconds to end by itself.
    // `MinJobAge`: jobs that have ended are remembered for longer than a test takes.
    Ok(format!(
        "ClusterName=tests
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={queue_port}
SlurmdPort={node_port}
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
SlurmUser=root
AuthInfo=socket={folder}/munge.socket,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
SchedulerParameters=sched_interval=1,sched_min_interval=0,batch_sched_delay=0,bf_interval=1
ReturnToService=2
KillWait=2
MinJobAge=3600
MailProg=/bin/true
GresTypes=gpu
NodeName={host} NodeAddr=127.0.0.1 CPUs=64 RealMemory=1000000 Gres=gpu:1
PartitionName=all Nodes=ALL Default=YES
"
    ))
}
