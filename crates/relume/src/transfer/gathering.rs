//! Which of the points at which light arrives have rows, and how the others take theirs.

use std::borrow::Cow;
use std::sync::Arc;

use super::Interpolation;
use super::blocks::Served;
use crate::sample::{Receiver, Records, Spacing, places_in};
use crate::trace::Accel;
use crate::{Progress, Result};

/// Points at which light arrives, and those of them that have rows.
pub(super) struct Gathering<'a> {
    points: Cow<'a, [Receiver]>,
    /// `None` where all have.
    records: Option<Records>,
}

impl<'a> Gathering<'a> {
    /// Of `points`, of which those that lie together come after each other. Without a spacing each has a row.
    ///
    /// # Errors
    /// Of [`Records::new`].
    pub(super) fn new(
        points: impl Into<Cow<'a, [Receiver]>>,
        accel: &Accel,
        spacing: Option<Spacing>,
        seed: u32,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let points = points.into();
        let records = |spacing| {
            progress.stage("records", 2 * points.len() as u64);
            Records::new(&points, accel, spacing, seed, progress)
        };
        let records = spacing.map(records).transpose()?;
        Ok(Self { points, records })
    }

    /// Whether each point has a row.
    pub(super) fn is_whole(&self) -> bool {
        self.records.is_none()
    }

    /// How many have.
    pub(super) fn records(&self) -> usize {
        self.records.as_ref().map_or(self.points.len(), |records| records.receivers.len())
    }

    /// The points that have rows, and how much of the picture each of these is.
    pub(super) fn rows(&self) -> (Cow<'_, [Receiver]>, Vec<Served>) {
        let Some(records) = &self.records else {
            return (Cow::Borrowed(&self.points), vec![Served::ONE; self.points.len()]);
        };
        let points = records.receivers.iter().map(|&number| self.points[number as usize]).collect();
        let served = records.served().into_iter().map(|(light, errors)| Served { light, errors });
        (points, served.collect())
    }

    /// How all points take their light from the rows, of which the `owners` are their numbers among those that have one. `None` where all have.
    pub(super) fn interpolation(&self, owners: &[u32]) -> Option<Arc<Interpolation>> {
        let records = self.records.as_ref()?;
        Some(Arc::new(Interpolation::new(records, &places_in(owners))))
    }
}
