//! The one file beside the frames that a simulation goes on from: everything that frames do not hold, to the bit.
//!
//! It is an NPZ archive of its own arrays, no frame, and written whole after each frame. It says whose it is: a hash of what
//! the simulation is made of, so that frames of two simulations are never mixed.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::ledger::{Ledger, Sum};
use super::spray::{SprayCounts, SprayState};
use super::{Setup, SimError, SimulatorState};
use crate::scene;
use crate::state::{Archive, ArchiveWriter, Packing, StateError, write_arrays};

/// The file's name, beside the frames.
pub const CHECKPOINT_NAME: &str = "simulation.checkpoint";

/// Of the arrays below. A file of another version is another simulation's.
const VERSION: u64 = 1;

/// Whose checkpoint it is: 256 bits over what the steps depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity([u64; 4]);

impl Identity {
    /// Of a simulation: its settings (but not for how long it runs, nor when it gives up), the time between frames (s), and
    /// what was made of the files that it names, so that a changed height map is another simulation, whatever its name.
    pub fn new(setup: &Setup, settings: &scene::Simulation, frame: f64) -> Self {
        let shown = scene::Simulation { duration: 0.0, most_steps: 1, ..settings.clone() };
        let mut hash = Sha256::new();
        hash.update(env!("CARGO_PKG_VERSION"));
        let mut shown = serde_json::to_value(&shown).expect("settings are plain data with string keys");
        if let (false, Some(keys)) = (settings.foam, shown.as_object_mut()) {
            // Without foam a simulation is the one that it was before there was any: its checkpoints go on.
            keys.shift_remove("foam");
        }
        hash.update(shown.to_string());
        hash.update(frame.to_le_bytes());
        for height in setup.base.iter().chain(&setup.depth) {
            hash.update(height.to_le_bytes());
        }
        // Debug shows every number so that it reads back to the same bits. Meshes are not among what spray bounces off.
        hash.update(format!("{:?}{:?}", setup.solids.panels, setup.solids.spheres));
        Self::of(hash)
    }

    /// The same simulation with foam, in columns deeper than `dry_threshold` (m). How foam is drawn is not part of it.
    pub fn with_foam(self, settings: &scene::Foam, dry_threshold: f64) -> Self {
        let scene::Foam { lifetime, renewal, limits, rate, .. } = settings;
        let mut hash = Sha256::new();
        self.0.iter().for_each(|word| hash.update(word.to_le_bytes()));
        hash.update(format!("{lifetime:?} {renewal:?} {limits:?} {rate:?} {dry_threshold:?}"));
        Self::of(hash)
    }

    fn of(hash: Sha256) -> Self {
        let bytes: [u8; 32] = hash.finalize().into();
        let (words, _) = bytes.as_chunks();
        Self([0, 1, 2, 3].map(|i| u64::from_le_bytes(words[i])))
    }
}

/// A simulation between two frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Whose it is.
    pub identity: Identity,
    /// The name of its frames, with `#` for the number.
    pub files: String,
    /// Frames that were written, from 0 on.
    pub frames: u64,
    /// Pieces of the settling before frame 0 that are over.
    pub settled: u64,
    /// Where it goes on.
    pub state: SimulatorState,
}

/// What a checkpoint says before anybody asks whether it can be gone on from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Made {
    /// The name of the frames that were made, with `#` for the number.
    pub files: String,
    /// How many, from 0 on.
    pub frames: u64,
}

impl Checkpoint {
    /// Where the checkpoint of the frames in `directory` is.
    pub fn path(directory: &Path) -> PathBuf {
        directory.join(CHECKPOINT_NAME)
    }

    /// Writes the file whole, in place of the one before.
    ///
    /// # Errors
    /// What the system says.
    pub fn save(&self, path: &Path) -> Result<(), SimError> {
        let SimulatorState { time, depth, pipes, spray, turbulence, foam, ledger } = &self.state;
        write_arrays(path, |archive| {
            // It is replaced after each frame: time matters, size does not.
            archive.pack(Packing::Stored);
            archive.array("version", &[], [VERSION])?;
            archive.array("identity", &[4], self.identity.0)?;
            archive.array("files", &[self.files.chars().count() as u64], self.files.chars().map(u32::from))?;
            archive.array("made", &[2], [self.frames, self.settled])?;
            archive.array("time", &[], [*time])?;
            let [entered, left] = [ledger.entered.parts(), ledger.left.parts()];
            floats(archive, "ledger", &[entered, left].concat())?;
            floats(archive, "depth", depth)?;
            floats(archive, "pipes", pipes)?;
            floats(archive, "turbulence", turbulence)?;
            if !foam.is_empty() {
                floats(archive, "foam", foam)?;
            }
            if let Some(spray) = spray {
                save_spray(archive, spray)?;
            }
            Ok(())
        })?;
        Ok(())
    }

    /// What a former run made, of whichever simulation.
    ///
    /// # Errors
    /// The file is damaged or cannot be read.
    pub fn made(path: &Path) -> Result<Made, SimError> {
        let mut archive = open(path)?;
        let [frames, _] = archive.fixed("made")?;
        Ok(Made { files: archive.files()?, frames })
    }

    /// Reads the file back.
    ///
    /// # Errors
    /// It is damaged, of another simulation, or cannot be read.
    pub fn load(path: &Path, identity: Identity) -> Result<Checkpoint, SimError> {
        let mut archive = open(path)?;
        if archive.fixed("version")? != [VERSION] || archive.fixed("identity")? != identity.0 {
            return Err(SimError::OtherSimulation { path: path.to_owned() });
        }
        let [frames, settled] = archive.fixed("made")?;
        let [time] = archive.fixed_floats("time")?;
        let [entered, entered_dropped, left, left_dropped] = archive.fixed_floats("ledger")?;
        let state = SimulatorState {
            time,
            depth: archive.floats("depth")?,
            pipes: archive.floats("pipes")?,
            turbulence: archive.floats("turbulence")?,
            foam: if archive.holds("foam") { archive.floats("foam")? } else { Vec::new() },
            spray: if archive.holds("spray_mass") { Some(load_spray(&mut archive)?) } else { None },
            ledger: Ledger {
                entered: Sum::from_parts([entered, entered_dropped]),
                left: Sum::from_parts([left, left_dropped]),
            },
        };
        Ok(Checkpoint { identity, files: archive.files()?, frames, settled, state })
    }
}

type Writer<'a, 'b> = ArchiveWriter<&'a mut BufWriter<&'b mut File>>;

fn floats(archive: &mut Writer, name: &str, values: &[f64]) -> Result<(), StateError> {
    archive.array(name, &[values.len() as u64], values.iter().copied())
}

/// A face's bits take four bytes here: the archive's reader knows no smaller whole numbers.
fn bits(archive: &mut Writer, name: &str, values: &[u8]) -> Result<(), StateError> {
    archive.array(name, &[values.len() as u64], values.iter().map(|&value| u32::from(value)))
}

fn save_spray(archive: &mut Writer, spray: &SprayState) -> Result<(), StateError> {
    // Named one by one, so that a field which is added is not forgotten here.
    let SprayState {
        position,
        velocity,
        mass,
        first_mass,
        age,
        id,
        demand,
        gathering,
        shedding,
        pressure,
        impacts,
        next_id,
        left,
        counts: SprayCounts { shed, absorbed, left: gone, refused },
    } = spray;
    floats(archive, "spray_position", position.as_flattened())?;
    floats(archive, "spray_velocity", velocity.as_flattened())?;
    floats(archive, "spray_mass", mass)?;
    floats(archive, "spray_first_mass", first_mass)?;
    floats(archive, "spray_age", age)?;
    archive.array("spray_id", &[id.len() as u64], id.iter().copied())?;
    floats(archive, "spray_demand", demand.as_flattened())?;
    bits(archive, "spray_gathering", gathering)?;
    bits(archive, "spray_shedding", shedding)?;
    floats(archive, "spray_pressure", pressure)?;
    floats(archive, "spray_impacts", impacts)?;
    floats(archive, "spray_left", &[*left])?;
    archive.array("spray_counts", &[5], [*next_id, *shed, *absorbed, *gone, *refused])
}

fn load_spray(archive: &mut Reader) -> Result<SprayState, SimError> {
    let [left] = archive.fixed_floats("spray_left")?;
    let [next_id, shed, absorbed, gone, refused] = archive.fixed("spray_counts")?;
    Ok(SprayState {
        position: archive.groups("spray_position")?,
        velocity: archive.groups("spray_velocity")?,
        mass: archive.floats("spray_mass")?,
        first_mass: archive.floats("spray_first_mass")?,
        age: archive.floats("spray_age")?,
        id: archive.whole("spray_id")?,
        demand: archive.groups("spray_demand")?,
        gathering: archive.bits("spray_gathering")?,
        shedding: archive.bits("spray_shedding")?,
        pressure: archive.floats("spray_pressure")?,
        impacts: archive.floats("spray_impacts")?,
        next_id,
        left,
        counts: SprayCounts { shed, absorbed, left: gone, refused },
    })
}

/// An open checkpoint.
struct Reader<'a> {
    path: &'a Path,
    archive: Archive,
}

fn open(path: &Path) -> Result<Reader<'_>, SimError> {
    let archive = Archive::open(path).map_err(damage(path))?;
    Ok(Reader { path, archive })
}

/// What is wrong with the file itself becomes a checkpoint's error, which says what to do; the system's errors stay.
fn damage(path: &Path) -> impl Fn(StateError) -> SimError {
    move |error| match error {
        StateError::Damaged { problems, .. } => {
            let problem = problems.first().map_or_else(String::new, ToString::to_string);
            SimError::BadCheckpoint { path: path.to_owned(), problem }
        }
        error => SimError::File(error),
    }
}

impl Reader<'_> {
    fn bad(&self, problem: impl Into<String>) -> SimError {
        SimError::BadCheckpoint { path: self.path.to_owned(), problem: problem.into() }
    }

    fn holds(&self, name: &str) -> bool {
        self.archive.shape(name).is_some()
    }

    fn floats(&mut self, name: &str) -> Result<Vec<f64>, SimError> {
        self.archive.read_finite(name).map_err(damage(self.path))
    }

    fn whole(&mut self, name: &str) -> Result<Vec<u64>, SimError> {
        self.archive.read_u64(name).map_err(damage(self.path))
    }

    fn groups<const N: usize>(&mut self, name: &str) -> Result<Vec<[f64; N]>, SimError> {
        let values = self.floats(name)?;
        match values.as_chunks() {
            (groups, []) => Ok(groups.to_vec()),
            _ => Err(self.bad(format!("array `{name}`: {} numbers; expected a multiple of {N}", values.len()))),
        }
    }

    fn bits(&mut self, name: &str) -> Result<Vec<u8>, SimError> {
        let values = self.whole(name)?;
        values
            .iter()
            .map(|&value| u8::try_from(value).map_err(|_| self.bad(format!("array `{name}`: {value}"))))
            .collect()
    }

    fn fixed_floats<const N: usize>(&mut self, name: &str) -> Result<[f64; N], SimError> {
        let values = self.floats(name)?;
        let count = values.len();
        values.try_into().map_err(|_| self.bad(format!("array `{name}`: {count} numbers; expected {N}")))
    }

    fn fixed<const N: usize>(&mut self, name: &str) -> Result<[u64; N], SimError> {
        let values = self.whole(name)?;
        let count = values.len();
        values.try_into().map_err(|_| self.bad(format!("array `{name}`: {count} numbers; expected {N}")))
    }

    /// The frames' name, as code points.
    fn files(&mut self) -> Result<String, SimError> {
        let points = self.whole("files")?;
        let name: Option<String> =
            points.iter().map(|&point| u32::try_from(point).ok().and_then(char::from_u32)).collect();
        name.ok_or_else(|| self.bad("array `files`: not text"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setup(settings: &scene::Simulation) -> Setup {
        super::super::prepare(settings, Path::new(".")).unwrap()
    }

    fn settings() -> scene::Simulation {
        let mut settings = scene::Simulation::default();
        settings.terrain.columns = Some([4, 3]);
        settings.water.depth = Some(0.5);
        settings
    }

    #[test]
    fn a_checkpoint_reads_back_to_the_bit() {
        let state = SimulatorState {
            time: 0.1 + 0.2,
            depth: (0..12).map(|i| f64::from(i) / 3.0).collect(),
            pipes: vec![-0.0, 1e-300, 7.5],
            spray: Some(SprayState {
                position: vec![[0.1, 0.2, 0.3]; 2],
                velocity: vec![[-1.0, 1.0 / 3.0, 0.0]; 2],
                mass: vec![0.1, 0.2],
                first_mass: vec![0.3, 0.4],
                age: vec![0.5, -0.25],
                id: vec![u64::MAX, 3],
                demand: vec![[0.1, 0.2, 0.3, 0.4]; 12],
                gathering: vec![15; 12],
                shedding: vec![9; 12],
                pressure: vec![5.0; 12],
                impacts: vec![6.0; 12],
                next_id: 11,
                left: 0.7,
                counts: SprayCounts { shed: 1, absorbed: 2, left: 3, refused: 4 },
            }),
            turbulence: vec![0.25; 24],
            foam: vec![0.5, 0.0, -0.25],
            ledger: Ledger { entered: Sum::from_parts([1.0, 1e-17]), left: Sum::from_parts([0.5, -1e-18]) },
        };
        let directory = tempfile::tempdir().unwrap();
        let path = Checkpoint::path(directory.path());
        let identity = Identity::new(&setup(&settings()), &settings(), 0.1);
        for state in [SimulatorState { spray: None, foam: Vec::new(), ..state.clone() }, state] {
            let files = "zeit_é###.state".to_owned();
            let checkpoint = Checkpoint { identity, files: files.clone(), frames: 7, settled: 3, state };
            checkpoint.save(&path).unwrap();
            assert_eq!(Checkpoint::load(&path, identity).unwrap(), checkpoint);
            assert_eq!(Checkpoint::made(&path).unwrap(), Made { files, frames: 7 });
        }
    }

    #[test]
    fn what_changes_a_step_changes_the_identity_and_nothing_else_does() {
        let plain = settings();
        let one = Identity::new(&setup(&plain), &plain, 0.1);
        let identity = |change: &dyn Fn(&mut scene::Simulation)| {
            let mut settings = settings();
            change(&mut settings);
            Identity::new(&setup(&settings), &settings, 0.1)
        };
        assert_eq!(identity(&|settings| settings.duration = 99.0), one);
        assert_eq!(identity(&|settings| settings.most_steps = 7), one);
        assert_ne!(identity(&|settings| settings.seed = 1), one);
        assert_ne!(identity(&|settings| settings.spray.volume = Some(1.0)), one);
        assert_ne!(identity(&|settings| settings.water.depth = Some(0.25)), one);
        assert_ne!(Identity::new(&setup(&plain), &plain, 0.2), one);
        let foam = |change: &dyn Fn(&mut scene::Foam)| {
            let mut foam = scene::Foam::default();
            change(&mut foam);
            one.with_foam(&foam, 0.001)
        };
        assert_ne!(foam(&|_| ()), one);
        assert_ne!(foam(&|foam| foam.limits.crest = [0.5, 9.0]), foam(&|_| ()));
        assert_ne!(foam(&|foam| foam.lifetime = 3.0), foam(&|_| ()));
        assert_eq!(foam(&|foam| foam.albedo = [0.5; 3]), foam(&|_| ()));
        let mut raised = setup(&plain);
        raised.base[5] += 1e-12;
        assert_ne!(Identity::new(&raised, &plain, 0.1), one);
    }
}
