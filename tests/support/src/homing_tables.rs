//! Where homing ends, by the tables of CiA 402-2, on a travel with both limit switches, a cam and an index pulse.

/// All homing methods.
pub const METHODS: [i8; 32] = [
    1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 33, 34, 35,
    37,
];

/// A travel, in counts of the shaft.
#[derive(Clone, Copy)]
pub struct Places {
    /// The limit switches are active at these counts and beyond.
    pub limits: (i64, i64),
    /// The home switch is active from the first to the last.
    pub cam: (i64, i64),
    /// The position of an index pulse; there is one every turn.
    pub index: i64,
    pub turn: i64,
}

impl Places {
    /// Where a method ends that starts outside the cam; `None`: it ends with an error, since it starts on the wrong
    /// side of the cam.
    pub fn home(&self, method: i8, start: i64) -> Option<i64> {
        let (first, last) = self.cam;
        let right = start > last;
        let (edge, direction) = match method {
            1 | 17 => (self.limits.0 + 1, 1),
            2 | 18 => (self.limits.1 - 1, -1),
            3 | 19 if !right => (first - 1, -1),
            4 | 20 if !right => (first, 1),
            5 | 21 if right => (last + 1, 1),
            6 | 22 if right => (last, -1),
            3..=6 | 19..=22 => return None,
            7 | 14 | 23 | 30 => (first - 1, -1),
            8 | 13 | 24 | 29 => (first, 1),
            10 | 11 | 26 | 27 => (last + 1, 1),
            9 | 12 | 25 | 28 => (last, -1),
            33 => (start, -1),
            34 => (start, 1),
            35 | 37 => return Some(start),
            _ => panic!("there is no method {method}"),
        };
        if (15..=30).contains(&method) {
            return Some(edge);
        }
        (1..=self.turn).map(|way| edge + direction * way).find(|at| (at - self.index) % self.turn == 0)
    }
}
