//! Parting all surfaces into as many cells as there are gather samples, finer where it matters.
//!
//! One greedy refinement serves all three clouds: the cell with the largest *weight* is halved until there are enough.
//! They differ in the weight (Hasan 2006, section 4.1, has the first two):
//!
//! - *uniform*: area.
//! - *importance*: how much of what the camera sees is lit by the cell, which is the sum of its form factors over view
//!   samples, with a floor by area so that no surface is forgotten.
//! - *adaptive*: a part of the cells by area, then by how strongly *single* view samples depend on the cell: the sum of
//!   the squares of its form factors, times a low power of its area. The error of a view sample is the error of a cell's
//!   light times its form factor, and squares add up over view samples; a corner that few pixels look into
//!   has little importance, and yet all of these pixels' light.

use std::collections::BinaryHeap;

use glam::Vec2;
use rayon::prelude::*;

use super::CloudMethod;
use super::cells::{Cell, Facet, WHOLE, halve_group, halves, in_second_half};
use super::sightings::{Sighting, Sightings, Tally};
use crate::scene::Geometry;
use crate::{Error, Progress, Result};

/// Share of the adaptive cells that are made by area first. More resolve lights that shine where the camera hardly
/// looks; fewer leave more for corners.
pub(super) const UNIFORM_SHARE: f64 = 0.25;
/// Power of the area in the adaptive weight.
const AREA_POWER: f64 = 0.25;
/// Share of the importance that is spread over all surfaces by area.
const IMPORTANCE_FLOOR: f64 = 0.25;
/// Weight of a cell that nothing was seen of, against its area.
const UNSEEN: f64 = 0.02;
/// Cells smaller than this, in square metres, are not halved again.
const SMALLEST: f32 = 1e-9;

/// A cell and the sightings of it.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub(super) cell: Cell,
    pub(super) area: f32,
    /// Of a piece, the numbers of its sightings; those of a group are all of its sides'.
    sightings: Vec<u32>,
}

impl Part {
    /// Several sides of triangles as one cell; one alone is a piece that can be cut.
    fn new(facets: Vec<Facet>, sightings: &Sightings) -> Self {
        let area = facets.iter().map(|facet| facet.area).sum();
        match facets[..] {
            [facet] => Self {
                cell: Cell::Piece(facet, WHOLE),
                area,
                sightings: sightings.of_side(facet.side()).collect(),
            },
            _ => Self { cell: Cell::Group(facets), area, sightings: Vec::new() },
        }
    }

    /// Sightings of the cell.
    fn seen(&self, sightings: &Sightings) -> usize {
        match &self.cell {
            Cell::Group(facets) => facets.iter().map(|facet| sightings.of_side(facet.side()).len()).sum(),
            Cell::Piece(..) => self.sightings.len(),
        }
    }

    /// The sightings of the cell, each with its side.
    pub(super) fn sightings(&self, sightings: &Sightings) -> Vec<(usize, Sighting)> {
        match &self.cell {
            Cell::Group(facets) => facets
                .iter()
                .flat_map(|facet| {
                    let side = facet.side();
                    sightings.of_side(side).map(move |number| (side, sightings.get(number)))
                })
                .collect(),
            Cell::Piece(facet, _) => {
                let of_piece = self.sightings.iter();
                of_piece.map(|&number| (facet.side(), sightings.get(number))).collect()
            }
        }
    }
}

/// Where a part's number is kept: see [`Cuts`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Sides,
    Half { cut: u32, second: bool },
}

/// Which cell holds a point of a side: a tree of halvings for each side that is cut.
#[derive(Clone, Debug, Default)]
pub(super) struct Cuts {
    /// By side: the number of its cell, or of its first cut.
    sides: Vec<Node>,
    cuts: Vec<[Node; 2]>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Node {
    Nothing,
    Cell(u32),
    Cut(u32),
}

impl Cuts {
    /// The cell at barycentric `uv` of a side.
    pub(super) fn cell_at(&self, geometry: &Geometry, side: usize, uv: Vec2) -> Option<u32> {
        let (mut node, mut piece) = (self.sides[side], WHOLE);
        loop {
            match node {
                Node::Nothing => return None,
                Node::Cell(cell) => return Some(cell),
                Node::Cut(cut) => {
                    let corners = geometry.corners(side / 2);
                    let second = usize::from(in_second_half(corners, piece, uv));
                    piece = halves(corners, piece)[second];
                    node = self.cuts[cut as usize][second];
                }
            }
        }
    }

    /// Gives cell `i` the number `numbers[i]`; cells with `u32::MAX` hold nothing any more.
    pub(super) fn renumber(&mut self, numbers: &[u32]) {
        let nodes = self.sides.iter_mut().chain(self.cuts.iter_mut().flatten());
        for node in nodes {
            if let Node::Cell(cell) = *node {
                *node = match numbers[cell as usize] {
                    u32::MAX => Node::Nothing,
                    number => Node::Cell(number),
                };
            }
        }
    }

    fn put(&mut self, part: &Part, place: Place, cell: u32) {
        match place {
            Place::Sides => {
                part.cell.facets().iter().for_each(|facet| self.sides[facet.side()] = Node::Cell(cell));
            }
            Place::Half { cut, second } => self.cuts[cut as usize][usize::from(second)] = Node::Cell(cell),
        }
    }

    /// Where the halves of a part at `place` are kept.
    fn places(&mut self, near: &Part, place: Place) -> [Place; 2] {
        let Cell::Piece(facet, _) = &near.cell else { return [Place::Sides; 2] };
        let whole = matches!(place, Place::Sides);
        if whole && matches!(near.cell, Cell::Piece(_, piece) if piece == WHOLE) {
            return [Place::Sides; 2];
        }
        let cut = self.cuts.len() as u32;
        self.cuts.push([Node::Nothing; 2]);
        match place {
            Place::Sides => self.sides[facet.side()] = Node::Cut(cut),
            Place::Half { cut: parent, second } => {
                self.cuts[parent as usize][usize::from(second)] = Node::Cut(cut);
            }
        }
        [Place::Half { cut, second: false }, Place::Half { cut, second: true }]
    }
}

/// What the refinement reads.
pub(super) struct Refinement<'a> {
    pub(super) geometry: &'a Geometry,
    pub(super) sightings: &'a Sightings,
    /// Metres that count as much as a difference of one between two unit normals.
    pub(super) normal_scale: f32,
}

/// By what a cell's weight is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Judge {
    Area,
    Importance,
    Pairs,
}

/// What all cells together are, for judging one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    pub(super) total_area: f64,
    /// Sightings by view samples.
    pub(super) by_views: usize,
    /// Their numbers are below this.
    pub(super) observers: usize,
}

impl Judge {
    /// The weight of a cell of this area with so many sightings, of which `observers` gives the observers.
    pub(super) fn weight(
        self,
        (area, seen): (f64, usize),
        observers: impl FnOnce() -> Vec<u32>,
        scale: &Scale,
    ) -> f64 {
        let by_area = if seen == 0 { UNSEEN * area } else { area };
        match self {
            Self::Area => by_area,
            Self::Importance => {
                let observers = observers();
                let views = observers.iter().filter(|&&observer| observer != Sighting::SURFACE).count();
                views as f64 / scale.by_views.max(1) as f64 + IMPORTANCE_FLOOR * by_area / scale.total_area
            }
            Self::Pairs => {
                let observers = observers();
                let pairs = TALLY.with_borrow_mut(|tally| tally.pairs(&observers, scale.observers));
                // the last term only orders cells in which no ray met another
                pairs * area.powf(AREA_POWER) + 1e-9 * by_area
            }
        }
    }
}

/// A cell that may be halved: its weight, and its number. The heaviest comes first, of equals the first.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Candidate(pub(super) f64, pub(super) u32);

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0).then(other.1.cmp(&self.1))
    }
}

impl Refinement<'_> {
    /// Parts `facets` into `count` cells, or as many as can be made, in an order in which neighbours follow each other.
    /// Also says which cell holds which point. All of it is so many `steps` of `progress`.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub(super) fn run(
        &self,
        facets: Vec<Facet>,
        method: CloudMethod,
        count: usize,
        (progress, steps): (&dyn Progress, u64),
    ) -> Result<(Vec<Part>, Cuts)> {
        let mut growing = Growing {
            refinement: self,
            progress,
            steps,
            told: 0,
            goal: count,
            cuts: Cuts { sides: vec![Node::Nothing; 2 * self.geometry.triangles.len()], cuts: Vec::new() },
            scale: Scale {
                total_area: facets.iter().map(|facet| f64::from(facet.area)).sum(),
                by_views: self.sightings.by_views(),
                observers: self.sightings.observers,
            },
            parts: Vec::new(),
            places: Vec::new(),
            next: Vec::new(),
        };
        growing.add(Part::new(facets, self.sightings), Place::Sides, None);
        match method {
            CloudMethod::Uniform => growing.grow(Judge::Area, count)?,
            CloudMethod::Importance => growing.grow(Judge::Importance, count)?,
            CloudMethod::Adaptive => {
                growing.grow(Judge::Area, (count as f64 * UNIFORM_SHARE) as usize)?;
                growing.grow(Judge::Pairs, count)?;
            }
        }
        growing.tell(steps);
        Ok(growing.in_order())
    }

    fn halve(&self, part: Part) -> [Part; 2] {
        match part.cell {
            Cell::Group(facets) => {
                halve_group(facets, self.normal_scale).map(|half| Part::new(half, self.sightings))
            }
            Cell::Piece(facet, piece) => {
                let corners = self.geometry.corners(facet.triangle as usize);
                let in_second =
                    |&number: &u32| in_second_half(corners, piece, self.sightings.get(number).uv());
                let (of_second, of_first): (Vec<_>, Vec<_>) = part.sightings.into_iter().partition(in_second);
                let [first, second] = halves(corners, piece);
                [(first, of_first), (second, of_second)].map(|(piece, sightings)| {
                    let cell = Cell::Piece(facet, piece);
                    Part { area: cell.area(self.geometry), cell, sightings }
                })
            }
        }
    }
}

struct Growing<'a> {
    refinement: &'a Refinement<'a>,
    progress: &'a dyn Progress,
    /// Of `progress`: in all, and how many it has been told.
    steps: u64,
    told: u64,
    /// Parts in the end.
    goal: usize,
    cuts: Cuts,
    scale: Scale,
    parts: Vec<Part>,
    places: Vec<Place>,
    /// The part that follows each one when the halves of what was halved stay together.
    next: Vec<u32>,
}

impl Growing<'_> {
    /// Adds a part that follows `before`.
    fn add(&mut self, part: Part, place: Place, before: Option<u32>) {
        let number = self.parts.len() as u32;
        self.parts.push(part);
        self.places.push(place);
        let next = before.map_or(number, |before| std::mem::replace(&mut self.next[before as usize], number));
        self.next.push(next);
    }

    /// The parts, halves together, and where they lie.
    fn in_order(mut self) -> (Vec<Part>, Cuts) {
        let mut parts = Vec::with_capacity(self.parts.len());
        let mut number = 0;
        while parts.len() < self.parts.len() {
            let part = self.take(number);
            self.cuts.put(&part, self.places[number as usize], parts.len() as u32);
            parts.push(part);
            number = self.next[number as usize];
        }
        (parts, self.cuts)
    }

    /// Tells that so many of all steps are done.
    fn tell(&mut self, done: u64) {
        self.progress.advance(done.saturating_sub(self.told));
        self.told = self.told.max(done);
    }

    /// Halves the heaviest cells until there are `count`. Several at a time, so that threads share the work; how many does
    /// not depend on the threads.
    fn grow(&mut self, judge: Judge, count: usize) -> Result<()> {
        let weights: Vec<f64> = self.parts.par_iter().map(|part| self.weight(judge, part)).collect();
        let mut heap: BinaryHeap<Candidate> = weights
            .into_iter()
            .enumerate()
            .map(|(number, weight)| Candidate(weight, number as u32))
            .collect();
        while self.parts.len() < count {
            if self.progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let most = (count - self.parts.len()).div_ceil(4).min(self.parts.len().div_ceil(4));
            let batch: Vec<u32> = (0..most)
                .map_while(|_| heap.pop())
                .take_while(|candidate| candidate.0 > 0.0)
                .map(|candidate| candidate.1)
                .collect();
            if batch.is_empty() {
                break;
            }
            let taken: Vec<Part> = batch.iter().map(|&number| self.take(number)).collect();
            let halved: Vec<[(Part, f64); 2]> = taken
                .into_par_iter()
                .with_max_len(64)
                .map(|part| {
                    self.refinement.halve(part).map(|part| {
                        let weight = self.weight(judge, &part);
                        (part, weight)
                    })
                })
                .collect();
            for (number, [(near, near_weight), (far, far_weight)]) in batch.into_iter().zip(halved) {
                let [place, far_place] = self.cuts.places(&near, self.places[number as usize]);
                heap.push(Candidate(near_weight, number));
                heap.push(Candidate(far_weight, self.parts.len() as u32));
                self.parts[number as usize] = near;
                self.places[number as usize] = place;
                self.add(far, far_place, Some(number));
            }
            self.tell(self.steps * self.parts.len() as u64 / self.goal as u64);
        }
        Ok(())
    }

    fn take(&mut self, number: u32) -> Part {
        let part = &mut self.parts[number as usize];
        std::mem::replace(part, Part { cell: Cell::Group(Vec::new()), area: 0.0, sightings: Vec::new() })
    }

    fn weight(&self, judge: Judge, part: &Part) -> f64 {
        if part.area < SMALLEST {
            return 0.0;
        }
        let sightings = self.refinement.sightings;
        let observers =
            || part.sightings(sightings).into_iter().map(|(_, sighting)| sighting.observer).collect();
        judge.weight((f64::from(part.area), part.seen(sightings)), observers, &self.scale)
    }
}

thread_local! {
    static TALLY: std::cell::RefCell<Tally> = std::cell::RefCell::default();
}
