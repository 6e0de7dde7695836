//! Requests that wait for a robot. Their number is bounded, each has a deadline, and its owner answers it exactly once.

use crate::frames::{read_request, send_refusal};
use crate::identity::number_of;
use crate::view::View;
use reagent_core::dims::MAX_POINTS;
use reagent_core::wire::{self, Cancel, Reason, Refusal, refuse_beginning};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use tokio::sync::{Notify, watch};
use zenoh::query::Query;
use zenoh::session::ZenohId;

/// Requests in hand, including the running one. One more is refused as busy.
pub const PLACES: usize = 5;
/// How many of these one session may hold, so that it does not shut out the others. Requests that do not say which session
/// made them count, too.
const SHARE: usize = PLACES - 1;
/// More requests a second than this are refused unread. It is several times what a robot can answer.
const RATE: f64 = 2000.0;
/// Longest time that a request may hold its place, whatever deadline it asks for.
const LONGEST_BUDGET: Duration = Duration::from_secs(600);

/// A request on its way through the robot. Its holder answers it, or drops it if nobody waits.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) query: Query,
    pub(crate) arrived: Instant,
    asked: Asked,
    deadline: Instant,
    taken_back: Arc<AtomicBool>,
}

/// A request, and the session that made it, if known: only that session can take it back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Asked {
    request: Cancel,
    session: Option<ZenohId>,
}

/// Why work on a job should end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stop {
    /// Its time has passed.
    Deadline,
    /// Nobody waits for its answer any more.
    TakenBack,
}

impl Job {
    /// Checked between two steps.
    pub(crate) fn check(&self) -> Result<(), Stop> {
        if self.taken_back.load(Ordering::Relaxed) {
            Err(Stop::TakenBack)
        } else if Instant::now() >= self.deadline {
            Err(Stop::Deadline)
        } else {
            Ok(())
        }
    }

    fn refuse(self, reason: Reason) {
        let id = self.asked.request.id;
        send_refusal(&self.query, Refusal { id, reason });
    }
}

/// The queue of one robot.
#[derive(Debug)]
pub(crate) struct Queue {
    state: Mutex<State>,
    allowance: Mutex<Allowance>,
    /// The worker has something to do.
    arrived: Notify,
    /// A new deadline that may be earlier than the others.
    earlier: Notify,
    view: Arc<watch::Sender<View>>,
}

#[derive(Debug, Default)]
struct State {
    waiting: VecDeque<Job>,
    /// The running job, and the flag that says that it has been taken back.
    running: Option<(Asked, Arc<AtomicBool>)>,
    closed: bool,
}

impl State {
    /// Every request that has a place.
    fn held(&self) -> impl Iterator<Item = Asked> + '_ {
        let running = self.running.iter().map(|(asked, _)| *asked);
        running.chain(self.waiting.iter().map(|job| job.asked))
    }

    /// Whether there is a place for one more. A request that does not say which session made it may be anybody's. So it counts
    /// towards every session's share, and it is accepted only while every session keeps a place of its share.
    fn has_place(&self, session: Option<ZenohId>) -> bool {
        let held = self.held().count();
        let share = match session {
            Some(_) => {
                let counts = |asked: &Asked| asked.session.is_none() || asked.session == session;
                self.held().filter(counts).count()
            }
            None => held + 1,
        };
        !self.closed && held < PLACES && share < SHARE
    }
}

/// How many more requests are allowed now.
#[derive(Debug)]
struct Allowance {
    left: f64,
    counted: Instant,
}

impl Allowance {
    fn take(&mut self, now: Instant) -> bool {
        let since = now.saturating_duration_since(self.counted).as_secs_f64();
        self.left = (self.left + RATE * since).min(RATE);
        self.counted = now;
        let allowed = self.left >= 1.0;
        if allowed {
            self.left -= 1.0;
        }
        allowed
    }
}

impl Queue {
    pub(crate) fn new(view: Arc<watch::Sender<View>>) -> Queue {
        Queue {
            state: Mutex::default(),
            allowance: Mutex::new(Allowance {
                left: RATE,
                counted: Instant::now(),
            }),
            arrived: Notify::new(),
            earlier: Notify::new(),
            view,
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no holder panics")
    }

    /// Puts a query into the queue. Refuses it at once if it is no request or one too many.
    pub(crate) fn offer(&self, query: Query) {
        let arrived = Instant::now();
        let mut allowance = self.allowance.lock().expect("no holder panics");
        let allowed = allowance.take(arrived);
        drop(allowance);
        if !allowed {
            let (id, reason) = (0, Reason::Busy);
            self.view.send_modify(|view| view.refused += 1);
            return send_refusal(&query, Refusal { id, reason });
        }
        let payload = query.payload().map(|p| p.to_bytes()).unwrap_or_default();
        let read = if payload.len() > wire::REQUEST_BYTES {
            Err(refuse_beginning(&payload, payload.len(), MAX_POINTS, false))
        } else {
            read_request(&payload).map(|request| {
                let budget = Duration::from_millis(request.budget_ms.into());
                (Cancel::of(&request), budget.min(LONGEST_BUDGET))
            })
        };
        drop(payload);
        let (request, budget) = match read {
            Ok(read) => read,
            Err(refusal) => {
                self.view.send_modify(|view| view.refused += 1);
                return send_refusal(&query, refusal);
            }
        };
        let session = query.source_info().map(|source| source.source_id().zid());
        let asked = Asked { request, session };
        let job = Job {
            query,
            arrived,
            asked,
            deadline: arrived + budget,
            taken_back: Arc::default(),
        };
        let mut state = self.state();
        if !state.has_place(session) {
            drop(state);
            self.view.send_modify(|view| view.refused += 1);
            return job.refuse(Reason::Busy);
        }
        // Counted before the worker can answer it.
        self.view
            .send_modify(|view| view.in_hand = view.in_hand.saturating_add(1));
        state.waiting.push_back(job);
        drop(state);
        self.arrived.notify_one();
        self.earlier.notify_one();
    }

    /// The next job for the worker; `None` when the queue is closed.
    pub(crate) async fn next(&self) -> Option<Job> {
        loop {
            {
                let mut state = self.state();
                if state.closed {
                    return None;
                }
                if let Some(job) = state.waiting.pop_front() {
                    state.running = Some((job.asked, job.taken_back.clone()));
                    return Some(job);
                }
            }
            self.arrived.notified().await;
        }
    }

    /// Frees the place of the running job. Called before the answer is sent, so that whoever receives it finds the place free.
    pub(crate) fn done(&self) {
        self.state().running = None;
    }

    /// Refuses waiting jobs whose deadline passes, until the queue is closed.
    pub(crate) async fn expire(&self) {
        loop {
            let now = Instant::now();
            let late = self.remove(|job| job.deadline <= now);
            self.view.send_modify(|view| {
                late.iter().for_each(|_| view.count_refused());
            });
            late.into_iter()
                .for_each(|job| job.refuse(Reason::Deadline));
            let (next, closed) = {
                let state = self.state();
                let next = state.waiting.iter().map(|job| job.deadline).min();
                (next, state.closed)
            };
            if closed {
                return;
            }
            let deadline = async {
                match next {
                    Some(next) => tokio::time::sleep_until(next.into()).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                () = deadline => {}
                () = self.earlier.notified() => {}
            }
        }
    }

    /// Takes back one request, if it is this session's.
    pub(crate) fn take_back(&self, request: Cancel, session: ZenohId) {
        let session = Some(session);
        self.take_back_where(|asked| asked == Asked { request, session });
    }

    /// Takes back every request of the session with this number, which has gone.
    pub(crate) fn session_gone(&self, number: u64) {
        self.take_back_where(|asked| asked.session.map(number_of) == Some(number));
    }

    fn take_back_where(&self, gone: impl Fn(Asked) -> bool) {
        if let Some((asked, taken_back)) = &self.state().running
            && gone(*asked)
        {
            taken_back.store(true, Ordering::Relaxed);
        }
        let dropped = self.remove(|job| gone(job.asked));
        if !dropped.is_empty() {
            self.view
                .send_modify(|view| dropped.iter().for_each(|_| view.count_taken_back()));
        }
    }

    /// Removes jobs from the queue.
    fn remove(&self, which: impl Fn(&Job) -> bool) -> Vec<Job> {
        let mut state = self.state();
        let (out, kept) = state.waiting.drain(..).partition(which);
        state.waiting = kept;
        Vec::from(out)
    }

    /// Ends the work. The running job is taken back. Waiting jobs are dropped, which tells their clients at once that nobody
    /// will answer.
    pub(crate) fn close(&self) {
        self.state().closed = true;
        self.take_back_where(|_| true);
        self.arrived.notify_one();
        self.earlier.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_cut_to_the_rate() {
        let start = Instant::now();
        let mut allowance = Allowance {
            left: RATE,
            counted: start,
        };
        // A hundred thousand a second, for three seconds.
        let flood = (0..300_000).map(|i| start + Duration::from_micros(10 * i));
        let allowed = flood.filter(|&now| allowance.take(now)).count() as f64;
        assert!((allowed - 4.0 * RATE).abs() < 2.0, "{allowed}");
    }
}
