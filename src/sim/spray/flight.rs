//! One particle's way through one step: exact parabolas through the air, bounces, and what it gives to the water it is in.
//!
//! In the water a particle gives its mass to the column at the rate m / τ. What holds it up there is its buoyancy ρ V g,
//! which equals its weight, and what brakes it is Stokes' drag 6 π μ r v; the water that it gives away brings its momentum
//! along. The reaction of all three, F over the column's footprint A, presses on the column: P = F / A. (The report's
//! F = -v μ - V ρ g and P = m / A are no force and no pressure; Stokes' drag alone would leave a drop's momentum nowhere, as
//! it is a ten-thousandth of what stops a drop of centimetres.)

use glam::DVec3;

use super::surroundings::{Event, Half, Medium, Surroundings, along};
use crate::sim::solids::Path;

/// Density of water (kg/m3).
pub(super) const DENSITY: f64 = 1000.0;
/// Dynamic viscosity of water at 20 degrees (Pa s).
pub(super) const VISCOSITY: f64 = 1.002e-3;
/// Share of its first mass at which a particle is swallowed whole.
pub(super) const LEAST_SHARE: f64 = 0.01;
/// Bounces in one step at most. A particle that needs more is caught in a corner, or crosses the map a hundred times in a
/// step; it then waits for the next step where it is.
const MOST_EVENTS: usize = 256;
/// Slides in one step at most: more than a few are a particle wedged between solids, which then rests.
const MOST_SLIDES: usize = 8;

/// The scene's choices.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rules {
    pub(super) gravity: f64,
    pub(super) restitution: f64,
    pub(super) absorption_time: f64,
}

/// One particle on its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drop {
    pub(super) position: DVec3,
    pub(super) velocity: DVec3,
    pub(super) mass: f64,
    pub(super) first_mass: f64,
}

/// What a column got from a particle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gift {
    pub(super) column: usize,
    /// Water (kg).
    pub(super) mass: f64,
    /// Push, downward positive (N s).
    pub(super) impulse: f64,
    /// Energy of motion that the particle lost to it (J).
    pub(super) energy: f64,
}

/// What became of a particle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    /// It goes on.
    Flies,
    /// All its water is in the columns.
    Absorbed,
    /// It left the map over a sink, with the mass it still has.
    Left,
}

/// Radius (m) of a ball of water of a mass (kg).
pub(super) fn radius(mass: f64) -> f64 {
    (mass / DENSITY * (3.0 / (4.0 * std::f64::consts::PI))).cbrt()
}

impl Drop {
    /// Flies for `time` seconds and hands out what columns get.
    pub(super) fn fly(&mut self, around: &Surroundings, rules: &Rules, time: f64, mut give: impl FnMut(Gift)) -> Fate {
        let mut half = around.half_at(self.position);
        if self.position.y < around.ground(self.position) {
            return self.soak(around, half, &mut give);
        }
        let mut medium = around.medium(half, self.position, radius(self.mass));
        let mut left = time;
        let mut slides = 0;
        let mut slide: Option<DVec3> = None;
        for _ in 0..MOST_EVENTS {
            if !(left > 0.0) {
                break;
            }
            if medium == Medium::Water && around.sink[around.column(half)] {
                return Fate::Left;
            }
            let radius = radius(self.mass);
            let before = self.velocity;
            let (braking, pull) = match medium {
                // 6 π μ r v over the mass.
                Medium::Water => (
                    6.0 * std::f64::consts::PI * VISCOSITY * radius / self.mass,
                    Some(around.pull_in_water(half, self.position, rules.gravity)),
                ),
                Medium::Air => (0.0, slide.take()),
            };
            let path = match pull {
                // Straight on, at the speed that the pull will have given it, so that it loses no less height than it gains
                // energy. Drag shortens the way: (1 - e^(-k t)) / k seconds' worth of it.
                Some(pull) => Path {
                    start: self.position,
                    velocity: self.velocity + pull * left,
                    acceleration: 0.0,
                    duration: if braking > 0.0 { -(-braking * left).exp_m1() / braking } else { left },
                },
                None => {
                    Path { start: self.position, velocity: self.velocity, acceleration: -rules.gravity, duration: left }
                }
            };
            let contact = around.solids.first_contact(&path);
            let clear = contact.map_or(path, |contact| Path { duration: contact.time, ..path });
            let stop = around.first_event(&clear, half, medium, radius);
            let within = std::mem::replace(&mut half, stop.half);

            let spent = if braking > 0.0 { -(-braking * stop.time).ln_1p() / braking } else { stop.time };
            // At the end of a braked way its time may come out as infinite.
            let spent = spent.clamp(0.0, left);
            self.position = path.at(stop.time);
            self.velocity = match pull {
                Some(pull) => self.velocity + pull * spent,
                None => path.velocity_at(stop.time),
            };
            if medium == Medium::Water {
                let column = around.taker(within, path.start.y, radius);
                if self.dissolve(rules, column, before, braking, spent, &mut give) {
                    return Fate::Absorbed;
                }
            }
            let column = around.column(half);
            // Rounding must not keep alive what has no time left.
            left = if spent < left { left - spent } else { 0.0 };

            match stop.event {
                Event::End => {
                    let Some(contact) = contact else { break };
                    self.position = contact.place;
                    let holds = rules.gravity * contact.normal.y;
                    let rebound = self.bounce(contact.normal, rules.restitution);
                    if medium == Medium::Air && rebound * rebound < 2.0 * holds * radius {
                        self.velocity = along(self.velocity, contact.normal);
                        slides += 1;
                        if slides > MOST_SLIDES {
                            self.velocity = DVec3::ZERO;
                            break;
                        }
                        slide = Some(along(DVec3::NEG_Y * rules.gravity, contact.normal));
                    }
                }
                Event::Ground(normal) => {
                    if around.sink[column] {
                        return Fate::Left;
                    }
                    self.position.y = self.position.y.max(around.ground(self.position));
                    if medium == Medium::Water {
                        // The bed stops it: it dissolves where it lies. A sheet of water carries it on in the next step.
                        self.velocity = DVec3::ZERO;
                        let taker = around.taker(half, self.position.y, radius);
                        let gone = self.dissolve(rules, taker, DVec3::ZERO, 0.0, left, &mut give);
                        return if gone { Fate::Absorbed } else { Fate::Flies };
                    }
                    let rebound = self.bounce(normal, rules.restitution);
                    // It would not rise off the ground by its own radius: it wets it.
                    let rises = rebound * rebound >= 2.0 * rules.gravity * normal.y * radius;
                    if !rises {
                        return self.soak(around, half, &mut give);
                    }
                }
                Event::Immersed => {
                    medium = Medium::Water;
                    if let Some(top) = around.water_height(half, self.position, radius) {
                        self.position.y = self.position.y.min(top);
                    }
                }
                Event::Emerged => {
                    medium = Medium::Air;
                    if let Some(top) = around.water_height(half, self.position, radius) {
                        self.position.y = self.position.y.max(top);
                    }
                }
                Event::Passed => medium = around.medium(half, self.position, radius),
                Event::Edge(axis) => {
                    if around.sink[column] {
                        return Fate::Left;
                    }
                    self.position = around.within(self.position);
                    if axis == 0 {
                        self.velocity.x = -self.velocity.x;
                    } else {
                        self.velocity.z = -self.velocity.z;
                    }
                }
            }
        }
        self.position = around.within(self.position);
        self.position.y = self.position.y.max(around.ground(self.position));
        if left > 0.0 && medium == Medium::Water {
            // Caught between events that take no time: it dissolves where it is, so that nothing stays for ever.
            let column = around.taker(half, self.position.y, radius(self.mass));
            if self.dissolve(rules, column, self.velocity, 0.0, left, &mut give) {
                return Fate::Absorbed;
            }
        }
        Fate::Flies
    }

    /// Turns the speed across a surface round, keeps that along it; says what is left of it (m/s).
    fn bounce(&mut self, normal: DVec3, restitution: f64) -> f64 {
        let inward = -self.velocity.dot(normal);
        if inward > 0.0 {
            self.velocity += normal * ((1.0 + restitution) * inward);
        }
        restitution * inward.max(0.0)
    }

    /// Gives all its water to the ground's column.
    fn soak(&mut self, around: &Surroundings, half: Half, give: &mut impl FnMut(Gift)) -> Fate {
        if around.sink[around.column(half)] {
            return Fate::Left;
        }
        let column = around.receiver(half, self.position.y);
        give(Gift { column, mass: self.mass, impulse: 0.0, energy: 0.0 });
        self.mass = 0.0;
        Fate::Absorbed
    }

    /// `time` seconds in a column's water; whether that was the end of the particle.
    ///
    /// Mass by dm/dt = -m / τ and speed by Stokes' drag, each exactly (the drag's rate as at the start); `first` is the speed
    /// (m/s) before. The impulse is what the particle's momentum lost and the time's integral of its weight, g τ (m_0 - m_1),
    /// whatever the forces between them; so it is the same for any step.
    fn dissolve(
        &mut self,
        rules: &Rules,
        column: usize,
        first: DVec3,
        braking: f64,
        time: f64,
        give: &mut impl FnMut(Gift),
    ) -> bool {
        let before = self.mass;
        let mut mass = before * (-time / rules.absorption_time).exp();
        self.velocity *= (-braking * time).exp();
        let weight = rules.gravity * rules.absorption_time * (before - mass);
        let swallowed = mass <= LEAST_SHARE * self.first_mass;
        if swallowed {
            mass = 0.0;
        }
        let lost = 0.5 * (before * first.length_squared() - mass * self.velocity.length_squared());
        give(Gift {
            column,
            mass: before - mass,
            impulse: mass * self.velocity.y - before * first.y + weight,
            // Running down in a sheet of water it may gain some; that is gravity's.
            energy: lost.max(0.0),
        });
        self.mass = mass;
        swallowed
    }
}
