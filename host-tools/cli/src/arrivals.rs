//! Several sources at once: a thread each, one channel.

use crate::source::{Input, Source};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Something from one of the sources.
pub(crate) struct Arrival {
    /// Which source, by its place in the list.
    pub(crate) source: usize,
    pub(crate) news: News,
}

/// What a source has to tell.
pub(crate) enum News {
    /// What came, as it came.
    Bytes(Vec<u8>),
    /// It cannot be reached, for this reason; attempts go on.
    Lost(String),
    /// It is reached again.
    Back,
    /// It says no more: it has ended, or failed for good.
    End(anyhow::Result<()>),
}

/// Chunks that may wait for a busy reader before the sources have to.
const WAITING: usize = 64;

/// Reads all sources; the threads end with their source, or when the receiver is gone.
pub(crate) fn hear(sources: Vec<Source>) -> Receiver<Arrival> {
    let (to_us, arrivals) = sync_channel(WAITING);
    for (index, source) in sources.into_iter().enumerate() {
        let to_us = to_us.clone();
        std::thread::spawn(move || follow(source, index, &to_us));
    }
    arrivals
}

fn follow(mut source: Source, index: usize, to: &SyncSender<Arrival>) {
    let mut buffer = [0; 4096];
    loop {
        let news = match source.read(&mut buffer) {
            Ok(Input::Silence) => continue,
            Ok(Input::Bytes(count)) => {
                News::Bytes(buffer.get(..count).unwrap_or_default().to_vec())
            }
            Ok(Input::Lost(why)) => News::Lost(why),
            Ok(Input::Back) => News::Back,
            Ok(Input::End) => News::End(Ok(())),
            Err(error) => News::End(Err(error)),
        };
        let ended = matches!(news, News::End(_));
        let arrival = Arrival {
            source: index,
            news,
        };
        if to.send(arrival).is_err() || ended {
            return;
        }
    }
}
