//! The version of a policy among those that its fleet knows.

use super::{Heard, PublishError, Publisher, refused, stored};
use crate::policy::WeightFile;
use reagent_core::wire::{Manifest, Release, keys};

impl Publisher {
    /// Refuses a version that is not newer, which some or all robots would not take, and one that leaves no versions
    /// for later policies.
    pub(super) async fn check_version(&mut self, manifest: &Manifest) -> Result<(), PublishError> {
        let given = manifest.release();
        let (last, sha256, by) = self.last().await?;
        if last > given || last == given && sha256 != Some(manifest.sha256) {
            let announced = last;
            return Err(match given.epoch < last.epoch {
                true => PublishError::Epoch {
                    given,
                    announced,
                    by,
                },
                false => PublishError::Version {
                    given,
                    announced,
                    by,
                },
            });
        }
        match given.is_far_ahead_of(last) {
            true => Err(PublishError::FarAhead { given, last }),
            false => Ok(()),
        }
    }

    /// The version to publish under by default: the time, in seconds since 1970. If the time is too far ahead of the
    /// last version, because versions were counted by hand, it is one more than the last.
    ///
    /// # Errors
    /// `Zenoh`.
    pub async fn default_version(&mut self, time: u64) -> Result<u64, PublishError> {
        let (last, ..) = self.last().await?;
        let next = Release {
            epoch: self.epoch,
            version: time,
        };
        let is_counted = next.epoch == last.epoch && next.is_far_ahead_of(last);
        Ok(match is_counted {
            true => last.version.saturating_add(1),
            false => time,
        })
    }

    /// Publishes a policy in the place of one that is taken back: under one version more than the newest that robots run.
    /// What others announce does not count. Where no robot runs it, none may trust its key, and robots that do take it.
    ///
    /// # Errors
    /// `FarAhead` if no version is left; as [`Publisher::publish`].
    pub async fn publish_over(
        &mut self,
        taken_back: Release,
        name: &str,
        file: WeightFile,
    ) -> Result<Manifest, PublishError> {
        self.before = self.follow().await?.robots;
        let run = self.before.values().filter_map(|status| status.policy);
        let last = run
            .map(|policy| policy.release())
            .fold(taken_back, Release::max);
        let given = Release {
            version: last.version.saturating_add(1),
            ..last
        };
        if given.is_far_ahead_of(last) {
            return Err(PublishError::FarAhead { given, last });
        }
        self.epoch = given.epoch;
        let manifest = self.manifest(given.version, name, &file)?;
        self.serve(&manifest, file).await?;
        self.announce(&manifest).await?;
        Ok(manifest)
    }

    /// The newest policy so far, the SHA-256 of its file, and who has it; version 0 if there is none.
    async fn last(&mut self) -> Result<(Release, Option<[u8; 32]>, String), PublishError> {
        let key = keys::manifest(&self.fleet).map_err(refused(&self.fleet))?;
        let own = self.newest.lock().expect("no holder panics").clone();
        let own = own.map_or_else(Release::default, |(own, _)| own.release());
        let announced = stored::announced(&self.session, &key).await?;
        let mut known = vec![(own, None, "was published from here".to_owned())];
        known.extend(announced.iter().map(|other| {
            let by = "is announced".to_owned();
            (other.release(), Some(other.sha256), by)
        }));
        self.before.clear();
        for Heard { robot, status } in self.robots().await? {
            self.before.insert(robot.clone(), status);
            let policy = status.policy.map(|policy| {
                let by = format!("robot {robot} runs");
                (policy.release(), Some(policy.sha256), by)
            });
            known.extend(policy);
        }
        // The same policy may be served from several places.
        Ok(known.into_iter().max().expect("its own is there"))
    }
}
