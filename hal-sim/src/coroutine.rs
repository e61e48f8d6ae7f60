//! A board's code as a coroutine with its own stack, so that ordinary blocking code can be paused in any HAL call.
//!
//! This is the crate's only unsafe code.

#![allow(unsafe_code)]

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::NonNull;
use std::rc::Rc;

use corosensei::stack::DefaultStack;
use corosensei::{Coroutine, CoroutineResult, Yielder};

/// What happened when a board's code was run.
pub(crate) enum Outcome {
    /// It waits in a HAL call.
    Paused,
    /// It returned.
    Finished,
    /// It panicked with this message.
    Panicked(String),
}

/// The board's code, paused.
pub(crate) struct BoardCode {
    coroutine: Coroutine<(), (), ()>,
    pause: PausePoint,
}

/// Lent by the coroutine to its body; `None` while the body does not exist.
type SharedYielder = Rc<Cell<Option<NonNull<Yielder<(), ()>>>>>;

/// Held by a board's HAL handles: gives control back to the scheduler.
#[derive(Clone, Default)]
pub(crate) struct PausePoint {
    yielder: SharedYielder,
}

impl BoardCode {
    /// Sets `code` up to run on a stack of `stack_bytes`.
    pub(crate) fn new(
        stack_bytes: usize,
        pause: PausePoint,
        code: impl FnOnce() + 'static,
    ) -> std::io::Result<Self> {
        let stack = DefaultStack::new(stack_bytes)?;
        let inside = pause.clone();
        let coroutine = Coroutine::with_stack(stack, move |yielder: &Yielder<(), ()>, ()| {
            inside.yielder.set(Some(NonNull::from(yielder)));
            code();
        });
        Ok(BoardCode { coroutine, pause })
    }

    /// Runs until the next pause.
    pub(crate) fn resume(&mut self) -> Outcome {
        let result = catch_unwind(AssertUnwindSafe(|| self.coroutine.resume(())));
        let outcome = match result {
            Ok(CoroutineResult::Yield(())) => return Outcome::Paused,
            Ok(CoroutineResult::Return(())) => Outcome::Finished,
            Err(payload) => Outcome::Panicked(message(payload.as_ref())),
        };
        self.pause.yielder.set(None);
        outcome
    }
}

impl PausePoint {
    /// Pauses the board's code until the scheduler resumes it. Must be called from within that code, which
    /// [`crate::board`] makes sure of; elsewhere it does nothing.
    pub(crate) fn pause(&self) {
        if let Some(yielder) = self.yielder.get() {
            // SAFETY: the pointer was taken from the reference that `Coroutine` lends to its body for as long as the
            // body runs, and `resume` forgets it when the body ends. The caller checks that this board's code is the
            // one running, so the yielder is used on its own stack only.
            unsafe { yielder.as_ref() }.suspend(());
        }
    }
}

fn message(payload: &(dyn Any + Send)) -> String {
    if let Some(text) = payload.downcast_ref::<&str>() {
        (*text).to_owned()
    } else if let Some(text) = payload.downcast_ref::<String>() {
        text.clone()
    } else {
        "panic without a message".to_owned()
    }
}
