//! Scripts and manifests that run a job array on its cluster.

use serde_json::{Value, json};

use super::{Cluster, Job, Need};

/// Script for Slurm or the shell, or manifest for Kubernetes as JSON.
pub fn script(job: &Job, need: &Need) -> String {
    match job.cluster {
        Cluster::Slurm => slurm(job, need),
        Cluster::Kubernetes => format!("{:#}\n", kubernetes(job, need)),
        Cluster::Local => local(job),
    }
}

fn slurm(job: &Job, need: &Need) -> String {
    let Job { shards, cpus, at_once, .. } = job;
    let logs = quoted(&job.out.join("logs/%A_%a.log").display().to_string());
    let (hours, minutes) = (need.minutes / 60, need.minutes % 60);
    let call = call(job, &format!("auto/{shards}"));
    format!(
        "#!/bin/bash\n\
         # {attempts} attempts in {shards} shards. A shard that was killed is queued again and goes on where it stopped;\n\
         # to finish what is missing, submit this file again. Then: genmanip merge {out} --out RUN\n\
         #SBATCH --job-name=genmanip\n\
         #SBATCH --array=0-{last}%{at_once}\n\
         #SBATCH --cpus-per-task={cpus}\n\
         #SBATCH --mem={memory}M\n\
         #SBATCH --time={hours:02}:{minutes:02}:00\n\
         #SBATCH --requeue\n\
         #SBATCH --open-mode=append\n\
         #SBATCH --output={logs}\n\
         exec {call}\n",
        attempts = job.attempts,
        out = quoted(&job.out.display().to_string()),
        last = shards - 1,
        memory = need.memory_mib,
    )
}

fn local(job: &Job) -> String {
    let Job { shards, at_once, .. } = job;
    format!(
        "#!/bin/sh\n\
         # {attempts} attempts in {shards} shards, {at_once} at a time. Start it again to finish what is missing.\n\
         # Then: genmanip merge {out} --out RUN\n\
         seq 0 {last} | xargs -P {at_once} -I SHARD {call}\n",
        attempts = job.attempts,
        out = quoted(&job.out.display().to_string()),
        last = shards - 1,
        call = call(job, &format!("SHARD/{shards}")),
    )
}

/// Shell command line of one shard; `shard` is the text of its `--shard` argument.
fn call(job: &Job, shard: &str) -> String {
    let program = job.program.display().to_string();
    words(job, shard, program).iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

fn words(job: &Job, shard: &str, program: String) -> Vec<String> {
    let more = ["--shard", shard, "--workers", &job.cpus.to_string(), "--quiet"].map(String::from);
    [program].into_iter().chain(job.arguments.iter().cloned()).chain(more).collect()
}

fn kubernetes(job: &Job, need: &Need) -> Value {
    let Some(container) = &job.container else { return Value::Null };
    let memory = format!("{}Mi", need.memory_mib);
    let mount = container.mount.display().to_string();
    json!({
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"name": "genmanip", "labels": {"app": "genmanip"}},
        "spec": {
            "completionMode": "Indexed",
            "completions": job.shards,
            "parallelism": job.at_once,
            // Number of retries of each shard; losing a node counts as a failure too.
            "backoffLimitPerIndex": 5,
            "template": {
                "metadata": {"labels": {"app": "genmanip"}},
                "spec": {
                    "restartPolicy": "Never",
                    "activeDeadlineSeconds": need.minutes * 60,
                    "containers": [{
                        "name": "collect",
                        "image": container.image,
                        "command": words(job, &format!("auto/{}", job.shards), "genmanip".into()),
                        "workingDir": mount,
                        "resources": {
                            "requests": {"cpu": job.cpus.to_string(), "memory": memory},
                            "limits": {"memory": memory},
                        },
                        "volumeMounts": [{"name": "data", "mountPath": mount}],
                    }],
                    "volumes": [{"name": "data", "persistentVolumeClaim": {"claimName": container.claim}}],
                },
            },
        },
    })
}

/// A word quoted for the shell, if necessary.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=%:,@+".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::launch::Container;

    fn job(cluster: Cluster) -> Job {
        let container =
            Container { image: "registry.example/genmanip:1".into(), claim: "runs".into(), mount: "/data".into() };
        Job {
            cluster,
            program: "/opt/genmanip".into(),
            arguments: ["collect", "my tasks", "--seed", "7", "--out", "out/it's"].map(String::from).into(),
            out: "out/it's".into(),
            shards: 8,
            attempts: 100,
            cpus: 2,
            at_once: 3,
            container: (cluster == Cluster::Kubernetes).then_some(container),
        }
    }

    const NEED: Need = Need { minutes: 125, memory_mib: 896, disk_mib: 300, core_hours: 0.5 };

    #[test]
    fn scripts_call_one_shard_each() {
        let slurm = script(&job(Cluster::Slurm), &NEED);
        let call =
            "exec /opt/genmanip collect 'my tasks' --seed 7 --out 'out/it'\\''s' --shard auto/8 --workers 2 --quiet";
        for line in
            ["#SBATCH --array=0-7%3", "#SBATCH --mem=896M", "#SBATCH --time=02:05:00", "#SBATCH --requeue", call]
        {
            assert!(slurm.lines().any(|found| found == line), "{line} in\n{slurm}");
        }
        let local = script(&job(Cluster::Local), &NEED);
        assert!(local.contains("seq 0 7 | xargs -P 3 -I SHARD /opt/genmanip collect 'my tasks'"), "{local}");
        assert!(local.contains("--shard SHARD/8"), "{local}");
    }

    /// Against the part of the API's schema that is used, where an unknown or misspelt field is an error.
    #[test]
    fn the_manifest_fits_the_schema_of_kubernetes() {
        let schema: Value = serde_json::from_str(include_str!("../../testdata/kubernetes_job.schema.json")).unwrap();
        let manifest: Value = serde_json::from_str(&script(&job(Cluster::Kubernetes), &NEED)).unwrap();
        assert_eq!(
            faults(&schema, &schema["definitions"]["io.k8s.api.batch.v1.Job"], &manifest, "$"),
            Vec::<String>::new()
        );
        for (pointer, value) in [
            ("/apiVersion", json!("batch/v2")),
            ("/spec/completions", json!("8")),
            ("/spec/template/spec/containers/0/comand", json!(["x"])),
            ("/spec/template/spec/containers/0/name", Value::Null),
        ] {
            let mut spoilt = manifest.clone();
            let (parent, key) = pointer.rsplit_once('/').unwrap();
            spoilt.pointer_mut(parent).unwrap()[key] = value;
            let found = faults(&schema, &schema["definitions"]["io.k8s.api.batch.v1.Job"], &spoilt, "$");
            assert!(!found.is_empty(), "{pointer}");
        }
    }

    /// Violations of the schema, for the keywords that it uses.
    fn faults(root: &Value, schema: &Value, value: &Value, place: &str) -> Vec<String> {
        if let Some(reference) = schema["$ref"].as_str() {
            let known = root.pointer(reference.trim_start_matches('#')).unwrap();
            return faults(root, known, value, place);
        }
        let mut found = Vec::new();
        let fits = match schema["type"].as_str() {
            Some("object") => value.is_object(),
            Some("array") => value.is_array(),
            Some("string") => value.is_string(),
            Some("integer") => value.is_i64() || value.is_u64(),
            Some("boolean") => value.is_boolean(),
            _ => true,
        };
        let is_listed = schema["enum"].as_array().is_none_or(|all| all.contains(value));
        if !fits || !is_listed {
            found.push(format!("{place}: {value} is not {}", schema["type"]));
        }
        for (key, entry) in value.as_object().into_iter().flatten() {
            let known = schema["properties"].get(key).or_else(|| schema.get("additionalProperties"));
            match known {
                Some(Value::Object(_)) => found.extend(faults(root, known.unwrap(), entry, &format!("{place}.{key}"))),
                _ => found.push(format!("{place}.{key}: unknown")),
            }
        }
        for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
            if value.get(key).is_none_or(Value::is_null) {
                found.push(format!("{place}.{key}: missing"));
            }
        }
        for (index, entry) in value.as_array().into_iter().flatten().enumerate() {
            found.extend(faults(root, &schema["items"], entry, &format!("{place}[{index}]")));
        }
        found
    }
}
