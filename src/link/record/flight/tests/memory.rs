//! A folder in memory, which can be full, can fail, and simulates power cuts.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::sync::{Arc, Mutex};

use super::super::folder::{Folder, KEPT, Output};
use super::super::writer::Bounds;

/// Random numbers that are the same on every machine (splitmix64).
pub struct Dice(pub u64);

impl Dice {
    pub fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ z >> 31) % n
    }
}

/// An operation on the folder.
#[derive(Clone, Debug)]
pub enum Op {
    Create(String),
    Append(String, Vec<u8>),
    Rename(String, String),
    Remove(String),
    Sync(String),
    SyncNames,
}

#[derive(Default)]
pub struct Inside {
    pub files: BTreeMap<String, Vec<u8>>,
    /// The operations so far, each with the number of the frame that was being recorded.
    pub log: Vec<(u64, Op)>,
    pub frame: u64,
    /// The most bytes of all files together.
    pub capacity: Option<u64>,
    /// The error that all operations on the folder return; `None`: they succeed.
    pub error: Option<io::ErrorKind>,
    /// The bytes of a file after which reading it fails.
    pub reads_max: Option<u64>,
    /// Bounds that must hold at any time.
    pub bounds: Option<Bounds>,
}

impl Inside {
    fn does(&mut self, op: Op) -> io::Result<()> {
        if let Some(error) = self.error {
            return Err(error.into());
        }
        if let (Op::Append(_, bytes), Some(capacity)) = (&op, self.capacity)
            && self.sum("") + bytes.len() as u64 > capacity
        {
            return Err(io::ErrorKind::StorageFull.into());
        }
        apply(&mut self.files, &op)?;
        if let Some(bounds) = self.bounds {
            assert!(self.sum("segment-") <= bounds.ring && self.sum(KEPT) <= bounds.kept + TEXTS_MAX, "{op:?}");
        }
        self.log.push((self.frame, op));
        Ok(())
    }

    fn sum(&self, begin: &str) -> u64 {
        self.files.iter().filter(|(name, _)| name.starts_with(begin)).map(|(_, bytes)| bytes.len() as u64).sum()
    }
}

/// The texts beside kept moments are not counted in their bound.
const TEXTS_MAX: u64 = 20_000;

fn apply(files: &mut BTreeMap<String, Vec<u8>>, op: &Op) -> io::Result<()> {
    let lacks = || io::Error::from(io::ErrorKind::NotFound);
    match op {
        Op::Create(name) => drop(files.insert(name.clone(), Vec::new())),
        Op::Append(name, bytes) => files.get_mut(name).ok_or_else(lacks)?.extend(bytes),
        Op::Rename(from, to) => {
            let bytes = files.remove(from).ok_or_else(lacks)?;
            files.insert(to.clone(), bytes);
        }
        Op::Remove(name) => drop(files.remove(name).ok_or_else(lacks)?),
        Op::Sync(name) => drop(files.get(name).ok_or_else(lacks)?),
        Op::SyncNames => {}
    }
    Ok(())
}

#[derive(Clone, Default)]
pub struct Memory(Arc<Mutex<Inside>>);

impl Memory {
    pub fn of(files: BTreeMap<String, Vec<u8>>) -> Self {
        Self(Arc::new(Mutex::new(Inside { files, ..Inside::default() })))
    }

    pub fn with<T>(&self, what: impl FnOnce(&mut Inside) -> T) -> T {
        what(&mut self.0.lock().unwrap())
    }

    fn does(&self, op: Op) -> io::Result<()> {
        self.with(|inside| inside.does(op))
    }

    pub fn files(&self) -> BTreeMap<String, Vec<u8>> {
        self.with(|inside| inside.files.clone())
    }
}

impl Folder for Memory {
    fn create(&self, name: &str) -> io::Result<Box<dyn Output>> {
        self.does(Op::Create(name.to_owned()))?;
        Ok(Box::new(InMemory { folder: self.clone(), name: name.to_owned() }))
    }

    fn open(&self, name: &str) -> io::Result<Box<dyn Read + Send>> {
        let bytes = self.with(|inside| match inside.error {
            Some(error) => Err(io::Error::from(error)),
            None => inside.files.get(name).cloned().ok_or_else(|| io::ErrorKind::NotFound.into()),
        })?;
        match self.with(|inside| inside.reads_max) {
            Some(max) => Ok(Box::new(io::Cursor::new(bytes).take(max).chain(Broken))),
            None => Ok(Box::new(io::Cursor::new(bytes))),
        }
    }

    fn list(&self) -> io::Result<Vec<(String, u64)>> {
        Ok(self.with(|inside| inside.files.iter().map(|(name, bytes)| (name.clone(), bytes.len() as u64)).collect()))
    }

    fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        self.does(Op::Rename(from.to_owned(), to.to_owned()))
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        self.does(Op::Remove(name.to_owned()))
    }

    fn sync(&self, name: &str) -> io::Result<()> {
        self.does(Op::Sync(name.to_owned()))
    }

    fn sync_names(&self) -> io::Result<()> {
        self.does(Op::SyncNames)
    }
}

/// A file whose reads fail.
struct Broken;

impl Read for Broken {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        Err(io::ErrorKind::Other.into())
    }
}

struct InMemory {
    folder: Memory,
    name: String,
}

impl Output for InMemory {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.folder.does(Op::Append(self.name.clone(), bytes.to_vec()))
    }
}

/// The contents of the disk after a power cut during the operation `at`: everything that was synced, and a random part
/// of the rest. Of the names that were not synced, a random number has been written, in their order.
pub fn after_cut(log: &[(u64, Op)], at: usize, dice: &mut Dice) -> BTreeMap<String, Vec<u8>> {
    struct File {
        bytes: Vec<u8>,
        synced: usize,
    }
    let mut files: Vec<File> = Vec::new();
    let (mut names, mut durable) = (BTreeMap::<String, usize>::new(), BTreeMap::<String, usize>::new());
    let mut since: Vec<(Op, usize)> = Vec::new();
    let rename = |names: &mut BTreeMap<String, usize>, op: &Op, file: usize| match op {
        Op::Create(name) => drop(names.insert(name.clone(), file)),
        Op::Rename(from, to) => {
            names.remove(from);
            names.insert(to.clone(), file);
        }
        Op::Remove(name) => drop(names.remove(name)),
        _ => {}
    };
    for (number, (_, op)) in log.iter().enumerate().take(at + 1) {
        match op {
            Op::Create(_) => {
                files.push(File { bytes: Vec::new(), synced: 0 });
                rename(&mut names, op, files.len() - 1);
                since.push((op.clone(), files.len() - 1));
            }
            Op::Append(name, bytes) => {
                let written = if number == at { dice.below(bytes.len() as u64 + 1) as usize } else { bytes.len() };
                files[names[name]].bytes.extend(&bytes[..written]);
            }
            Op::Rename(name, _) | Op::Remove(name) => {
                let file = names[name];
                rename(&mut names, op, file);
                since.push((op.clone(), file));
            }
            Op::Sync(name) if number < at => files[names[name]].synced = files[names[name]].bytes.len(),
            Op::SyncNames if number < at => {
                durable = names.clone();
                since.clear();
            }
            Op::Sync(_) | Op::SyncNames => {}
        }
    }
    let written = dice.below(since.len() as u64 + 1) as usize;
    since.iter().take(written).for_each(|(op, file)| rename(&mut durable, op, *file));
    durable.retain(|_, file| *file < files.len());
    let mut there = BTreeMap::new();
    for (name, file) in durable {
        let File { bytes, synced } = &files[file];
        let mut bytes = bytes[..synced + dice.below((bytes.len() - synced) as u64 + 1) as usize].to_vec();
        if bytes.len() > *synced {
            // What was not synced may be anything: zeros, or a sector of it is missing.
            match dice.below(4) {
                0 => bytes[*synced..].fill(0),
                1 => {
                    let from = synced + dice.below((bytes.len() - synced) as u64) as usize;
                    let to = bytes.len().min(from + 512);
                    bytes[from..to].fill(0);
                }
                _ => {}
            }
        }
        there.insert(name, bytes);
    }
    there
}
