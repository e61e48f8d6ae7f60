//! Reads a problem.

use std::error::Error;

use nalgebra::Vector3;

/// Lines of a word and numbers, in order.
pub(crate) struct Problem(Vec<(String, Vec<f64>)>);

impl Problem {
    pub(crate) fn read(path: &str) -> Result<Self, Box<dyn Error>> {
        let text = std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"))?;
        let mut lines = Vec::new();
        for line in text.lines() {
            let mut words = line.split_whitespace();
            let Some(word) = words.next() else {
                continue;
            };
            let numbers = words.map(str::parse).collect::<Result<_, _>>();
            lines.push((
                word.to_owned(),
                numbers.map_err(|e| format!("{line}: {e}"))?,
            ));
        }
        Ok(Self(lines))
    }

    /// The numbers of all lines with this word, `N` of them each.
    pub(crate) fn all<const N: usize>(&self, word: &str) -> Result<Vec<[f64; N]>, Box<dyn Error>> {
        let lines = self.0.iter().filter(|(w, _)| w == word);
        lines
            .map(|(_, numbers)| {
                let numbers: Result<[f64; N], _> = numbers.as_slice().try_into();
                numbers.map_err(|_| format!("{word}: not {N} numbers").into())
            })
            .collect()
    }

    /// The numbers of the one line with this word.
    pub(crate) fn one<const N: usize>(&self, word: &str) -> Result<[f64; N], Box<dyn Error>> {
        match self.all(word)?.as_slice() {
            [numbers] => Ok(*numbers),
            lines => Err(format!("{word}: {} lines, not one", lines.len()).into()),
        }
    }

    pub(crate) fn place(&self, word: &str) -> Result<Vector3<f64>, Box<dyn Error>> {
        Ok(Vector3::from(self.one::<3>(word)?))
    }
}
