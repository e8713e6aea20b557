//! A batch script of Slurm that runs a wall on any number of nodes.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::net::Ipv4Addr;

use polyptych_tls::NodeIdentity;
use polyptych_wall_file::LaunchOutput;

use super::plan::{LaunchPlan, ManagerPlace, ServerPlace, machine_of};
use super::shell::{line, quoted};
use super::unit_file::{UnitFile, UnitFiles, head};

/// Placeholders for addresses that the script knows when it runs.
const LISTEN: &str = "@LISTEN@";
const MANAGER: &str = "@MANAGER@";

/// The script of a wall.
pub(crate) fn units(plan: &LaunchPlan) -> anyhow::Result<UnitFiles> {
    let port = plan.wall.listen.rsplit_once(':').map_or("7878", |(_, port)| port);
    if port == "0" {
        let what =
            "port 0 is any free one, and servers must be told which; write one, such as 7878";
        return Err(plan.fault("network.listen", what));
    }
    let name = format!("polyptych-{}.sh", plan.wall.name);
    let steps = vec![format!("sbatch {{DIR}}/{name}   (scancel ends it)")];
    let files = vec![UnitFile::script(name, script(plan, port))];
    Ok(UnitFiles { files, steps })
}

fn script(plan: &LaunchPlan, port: &str) -> String {
    let launch = &plan.launch;
    let hosts = launch.servers.values().map(|server| server.host.as_deref());
    let hosts = hosts.chain([launch.manager_host.as_deref()]);
    let nodes: Option<BTreeSet<&str>> = hosts.map(|host| machine_of(host).map(node_name)).collect();
    let count = launch.servers.len();
    let gpus: u32 = launch.servers.values().map(|server| server.gpus).sum();
    let mut text = String::from("#!/bin/bash\n");
    text.push_str(&head(plan, "slurm"));
    let _ = write!(
        text,
        "# It runs on any number of nodes: sbatch --nodes=N chooses, and --nodelist=... which. It\n\
         # ends with the manager.\n\
         #SBATCH --job-name=polyptych-{}\n\
         #SBATCH --ntasks={}\n",
        plan.wall.name,
        count + 1
    );
    match nodes {
        Some(nodes) => {
            let _ = writeln!(text, "#SBATCH --nodes={}", nodes.len());
            if !nodes.iter().any(|node| is_address(node)) {
                let list = nodes.into_iter().collect::<Vec<_>>().join(",");
                let _ = writeln!(text, "#SBATCH --nodelist={list}");
            }
        }
        None => {
            let _ = writeln!(text, "#SBATCH --nodes=1-{count}");
        }
    }
    if gpus > 0 {
        let _ = writeln!(text, "#SBATCH --gpus={gpus}");
    }
    let may_leave = if plan.may_leave_machine() { "yes" } else { "no" };
    let _ = write!(
        text,
        "#SBATCH --signal=B:TERM@30\nset -u\nport={port}\n\
         may_leave_machine={may_leave}\njob_gpus={gpus}\n{FUNCTIONS}\n"
    );
    let manager_host = machine_of(launch.manager_host.as_deref()).unwrap_or_default();
    let _ = writeln!(text, "choose_address {}", quoted(manager_host));
    let _ = writeln!(text, "\nrun manager \"$manager_node\" 0 \\\n    {}", manager(plan));
    for (index, (name, server)) in launch.servers.iter().enumerate() {
        let host = quoted(machine_of(server.host.as_deref()).unwrap_or_default());
        let _ = writeln!(
            text,
            "run {} \"$(node_of {host} {index})\" {} \\\n    {}",
            quoted(name),
            server.gpus,
            self::server(plan, name)
        );
    }
    text.push_str(END);
    text
}

/// Returns the name of a machine's node: Slurm calls most nodes by the first part of their names
/// in ssh. An address stays whole.
fn node_name(machine: &str) -> &str {
    if is_address(machine) {
        return machine;
    }
    machine.split_once('.').map_or(machine, |(node, _)| node)
}

/// Returns whether a machine is named by its address, which names no node.
fn is_address(machine: &str) -> bool {
    machine.contains(':') || machine.parse::<Ipv4Addr>().is_ok()
}

fn manager(plan: &LaunchPlan) -> String {
    let arguments = plan.manager_arguments(ManagerPlace {
        wall: &plan.wall_there(),
        listen: LISTEN,
        keys: plan.keys_of(&NodeIdentity::Manager).as_deref(),
        is_insecure: plan.launch.is_insecure,
    });
    command(plan, &plan.launch.environment, &arguments)
}

fn server(plan: &LaunchPlan, name: &str) -> String {
    let arguments = plan.server_arguments(
        name,
        ServerPlace {
            manager: MANAGER,
            keys: plan.keys_of(&NodeIdentity::Server(name.to_owned())).as_deref(),
            is_insecure: plan.launch.is_insecure,
            output_default: LaunchOutput::Headless,
        },
    );
    command(plan, &plan.launch.servers[name].environment, &arguments)
}

fn command(
    plan: &LaunchPlan,
    environment: &std::collections::BTreeMap<String, String>,
    arguments: &[String],
) -> String {
    let variables: Vec<String> =
        environment.iter().map(|(name, value)| format!("{name}={value}")).collect();
    let words = variables.iter().map(String::as_str);
    let words = words.chain([plan.launch.program.as_str()]);
    let words = line(words.chain(arguments.iter().map(String::as_str)));
    words.replace(LISTEN, "\"$listen\"").replace(MANAGER, "\"$address\"")
}

/// Placing of processes, and their restarts.
const FUNCTIONS: &str = r#"
mapfile -t nodes < <(scontrol show hostnames "$SLURM_JOB_NODELIST")
if [ "${#nodes[@]}" -eq 0 ]; then
    echo 'polyptych: the job has no nodes; submit this script with sbatch' >&2
    exit 1
fi

# The node HOST if the job has it, else one of its nodes by turns.
node_of() { # HOST INDEX
    local node
    for node in "${nodes[@]}"; do
        [ -z "$1" ] || [ "${node%%.*}" != "${1%%.*}" ] || { echo "$node"; return; }
    done
    echo "${nodes[$2 % ${#nodes[@]}]}"
}

choose_address() { # HOST
    manager_node=$(node_of "$1" 0)
    if [ "${#nodes[@]}" -eq 1 ]; then
        listen=127.0.0.1:$port address=127.0.0.1:$port
    elif [ "$may_leave_machine" = yes ]; then
        listen=0.0.0.0:$port address=$manager_node:$port
    else
        echo 'polyptych: without keys nothing is encrypted; write keys = "/FOLDER" under [launch]' \
            'of the wall file and make this script again, or run it with --nodes=1' >&2
        exit 1
    fi
}

# Runs a step again when it fails, but not if it failed 5 times within a minute.
keep() { # NAME COMMAND...
    local name=$1 code step='' ending='' begun=()
    shift
    trap 'ending=1; [ -z "$step" ] || kill -TERM "$step" 2>/dev/null' TERM
    while :; do
        begun+=("$SECONDS")
        "$@" &
        step=$!
        [ -z "$ending" ] || kill -TERM "$step" 2>/dev/null
        wait "$step"
        code=$?
        # A signal ends the waiting, not the step.
        while kill -0 "$step" 2>/dev/null; do
            wait "$step"
            code=$?
        done
        [ -z "$ending" ] || return 0
        [ "$code" -ne 0 ] || return 0
        if [ "${#begun[@]}" -ge 5 ] && [ $((SECONDS - begun[-5])) -lt 60 ]; then
            echo "polyptych: $name failed 5 times within a minute, the last time with $code;" \
                'it is not started again' >&2
            return "$code"
        fi
        echo "polyptych: $name ended with $code; starting it again" >&2
        sleep 1
    done
}

# sbatch exports the GPUs of the whole job, and each srun would ask for all of them.
unset SLURM_GPUS SLURM_GPUS_PER_NODE SLURM_GPUS_PER_TASK SLURM_TRES_PER_TASK SLURM_GRES

kept=()
run() { # NAME NODE GPUS COMMAND...
    local name=$1 node=$2 shares=(--overlap)
    if [ "$3" -gt 0 ]; then
        # Steps that overlap would all get the first GPU of their node.
        shares=(--exact --mem=0 --gpus-per-task="$3")
        shares+=(${SLURM_CPUS_PER_TASK:+--cpus-per-task="$SLURM_CPUS_PER_TASK"})
    elif [ "$job_gpus" -gt 0 ]; then
        shares+=(--gpus=0)
    fi
    shift 3
    echo "polyptych: $name on $node"
    keep "$name" srun --nodes=1 --ntasks=1 --nodelist="$node" --input=none \
        --job-name="$name" "${shares[@]}" env "$@" &
    kept+=("$!")
}

trap '[ "${#kept[@]}" -gt 0 ] || exit 143; kill -TERM "${kept[@]}" 2>/dev/null' TERM INT
"#;

const END: &str = r#"
manager=${kept[0]}
wait "$manager"
code=$?
while kill -0 "$manager" 2>/dev/null; do
    wait "$manager"
    code=$?
done
kill -TERM "${kept[@]}" 2>/dev/null
wait
exit "$code"
"#;
