//! Fingerprints of results that must have the same bits on any number of ranks and process mesh.

use crate::Tally;
use phasewarp::parallel::communicator::World;
use std::collections::{BTreeMap, BTreeSet};

/// Prints a fingerprint (FNV-1a) of `values`. The parent compares it with the fingerprints of other
/// numbers of ranks and meshes.
pub fn report_bits(world: &World, name: &str, values: &[f64]) {
    if world.group().rank() == 0 {
        let hash = values
            .iter()
            .flat_map(|v| v.to_bits().to_le_bytes())
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
            });
        println!("bits {hash:016x} {name}");
    }
}

/// The fingerprints of each quantity, and the number of its reports.
#[derive(Default)]
pub struct Bits(BTreeMap<String, (BTreeSet<String>, usize)>);

impl Bits {
    /// Collects the fingerprints from the standard output of a job.
    pub fn read(&mut self, stdout: &str) {
        for line in stdout.lines() {
            if let Some((hash, name)) = line.strip_prefix("bits ").and_then(|l| l.split_once(' ')) {
                let (hashes, times) = self.0.entry(name.to_owned()).or_default();
                hashes.insert(hash.to_owned());
                *times += 1;
            }
        }
    }

    /// A quantity passes if it was reported `least` times or more, always with the same
    /// fingerprint, and no other quantity has this fingerprint. If different quantities had the
    /// same fingerprint, the comparison would show nothing.
    pub fn compare(&self, least: usize, all: bool, tally: &mut Tally) {
        let mut others: BTreeSet<&String> = BTreeSet::new();
        for (name, (hashes, times)) in &self.0 {
            let own = hashes.iter().all(|hash| !others.contains(hash));
            let passed = hashes.len() == 1 && *times >= least && own;
            let reason = format!("{} fingerprints in {times} reports; unique: {own}", hashes.len());
            tally.count(&format!("bits of {name}"), passed, &reason);
            others.extend(hashes);
        }
        if all {
            let reason = format!("{} quantities", self.0.len());
            tally.count("bits were compared", self.0.len() >= 50, &reason);
        }
    }
}
