//! Where pages leave their requests and a single thread renders them.
//!
//! Each page has a seat with room for one request: a newer one takes the place of an older one that nobody has begun.
//! Seats take turns. Nothing here grows with the number of messages.

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use super::frame::Answer;
use super::protocol::FrameRequest;

/// Most pages at a time.
pub const MOST_PAGES: usize = 8;

/// The desk, shared by the server and the thread that renders.
#[derive(Debug, Default)]
pub struct Desk {
    state: Mutex<State>,
    /// Told of every new request and order.
    news: Condvar,
}

#[derive(Debug, Default)]
struct State {
    seats: BTreeMap<SeatId, Seat>,
    next: u64,
    /// The seat that was served last.
    served: SeatId,
    orders: Orders,
}

/// The number of a seat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct SeatId(u64);

#[derive(Debug)]
struct Seat {
    waiting: Option<Box<FrameRequest>>,
    answer: watch::Sender<Option<Answer>>,
}

/// What pages have ordered since the last look. Of contrary orders, the last one counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Orders {
    /// Pause, or go on.
    pub pause: Option<bool>,
    /// Save a checkpoint.
    pub checkpoint: bool,
}

/// A page's side of the desk. Dropping it gives the seat back.
#[derive(Debug)]
pub struct Client {
    desk: Arc<Desk>,
    seat: SeatId,
    /// The newest answer.
    pub answers: watch::Receiver<Option<Answer>>,
}

impl Desk {
    /// Takes a seat; `None` if all are taken.
    pub fn join(self: &Arc<Self>) -> Option<Client> {
        let mut state = self.state();
        if state.seats.len() >= MOST_PAGES {
            return None;
        }
        state.next += 1;
        let seat = SeatId(state.next);
        let (answer, answers) = watch::channel(None);
        state.seats.insert(seat, Seat { waiting: None, answer });
        Some(Client { desk: Arc::clone(self), seat, answers })
    }

    /// Number of pages.
    pub fn pages(&self) -> usize {
        self.state().seats.len()
    }

    /// Whether a request waits.
    pub fn is_asked(&self) -> bool {
        self.state().seats.values().any(|seat| seat.waiting.is_some())
    }

    /// Takes the next request, in turns among the pages. Waits for one, or for an order, at most for `patience`.
    pub fn take(&self, patience: Duration) -> Option<(SeatId, Box<FrameRequest>)> {
        let mut state = self.state();
        if let Some(found) = state.take() {
            return Some(found);
        }
        if !patience.is_zero() && state.orders == Orders::default() {
            (state, _) = self.news.wait_timeout(state, patience).unwrap_or_else(PoisonError::into_inner);
        }
        state.take()
    }

    /// Answers a page, if it is still there.
    pub fn answer(&self, seat: SeatId, answer: Answer) {
        if let Some(seat) = self.state().seats.get(&seat) {
            seat.answer.send_replace(Some(answer));
        }
    }

    /// The orders since the last call.
    pub fn orders(&self) -> Orders {
        std::mem::take(&mut self.state().orders)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A panic elsewhere leaves seats and orders sound: each change is one assignment.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn take(&mut self) -> Option<(SeatId, Box<FrameRequest>)> {
        let served = self.served;
        let waiting = |(id, seat): (&SeatId, &Seat)| seat.waiting.is_some().then_some(*id);
        let after = self.seats.iter().filter(|(id, _)| **id > served).find_map(waiting);
        let next = after.or_else(|| self.seats.iter().find_map(waiting))?;
        self.served = next;
        let request = self.seats.get_mut(&next)?.waiting.take()?;
        Some((next, request))
    }
}

impl Client {
    /// Asks for a picture, instead of the one that was asked for before and not yet begun.
    pub fn ask(&self, request: Box<FrameRequest>) {
        if let Some(seat) = self.desk.state().seats.get_mut(&self.seat) {
            seat.waiting = Some(request);
        }
        self.desk.news.notify_one();
    }

    /// Orders a pause, or that the training goes on.
    pub fn order_pause(&self, is_paused: bool) {
        self.desk.state().orders.pause = Some(is_paused);
        self.desk.news.notify_one();
    }

    /// Orders a checkpoint.
    pub fn order_checkpoint(&self) {
        self.desk.state().orders.checkpoint = true;
        self.desk.news.notify_one();
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.desk.state().seats.remove(&self.seat);
    }
}

#[cfg(test)]
mod tests {
    use super::super::protocol::Message;
    use super::super::protocol::tests::{LIMITS, request};
    use super::*;

    fn wanted(id: u64) -> Box<FrameRequest> {
        match Message::parse(&request(id).to_string(), &LIMITS) {
            Ok(Message::Frame(request)) => request,
            other => panic!("{other:?}"),
        }
    }

    fn taken(desk: &Desk) -> Option<u64> {
        desk.take(Duration::ZERO).map(|(_, request)| request.id)
    }

    #[test]
    fn the_newest_request_of_a_page_wins() {
        let desk = Arc::new(Desk::default());
        let page = desk.join().expect("a seat");
        (0..1000).for_each(|id| page.ask(wanted(id)));
        assert!(desk.is_asked());
        assert_eq!((taken(&desk), taken(&desk)), (Some(999), None));
    }

    #[test]
    fn pages_take_turns_however_much_one_asks() {
        let desk = Arc::new(Desk::default());
        let [greedy, modest] = [(); 2].map(|()| desk.join().expect("a seat"));
        modest.ask(wanted(1000));
        let served: Vec<u64> = (0..3)
            .filter_map(|id| {
                greedy.ask(wanted(id));
                taken(&desk)
            })
            .collect();
        assert_eq!(served, [0, 1000, 2]);
    }

    #[test]
    fn seats_are_few_and_come_back() {
        let desk = Arc::new(Desk::default());
        let pages: Vec<Client> = (0..MOST_PAGES).map(|_| desk.join().expect("a seat")).collect();
        assert!(desk.join().is_none());
        drop(pages);
        assert_eq!(desk.pages(), 0);
        assert!(desk.join().is_some());
    }

    #[test]
    fn the_request_of_a_page_that_has_left_is_forgotten() {
        let desk = Arc::new(Desk::default());
        let page = desk.join().expect("a seat");
        page.ask(wanted(1));
        let (seat, _) = desk.take(Duration::ZERO).expect("a request");
        drop(page);
        desk.answer(seat, Answer::Refused { id: 1, reason: "nobody hears it".to_owned() });
        assert_eq!(taken(&desk), None);
    }

    #[test]
    fn orders_are_told_once_and_the_last_one_counts() {
        let desk = Arc::new(Desk::default());
        let page = desk.join().expect("a seat");
        page.order_pause(true);
        page.order_pause(false);
        page.order_checkpoint();
        assert_eq!(desk.orders(), Orders { pause: Some(false), checkpoint: true });
        assert_eq!(desk.orders(), Orders::default());
    }

    #[test]
    fn an_answer_reaches_its_page_alone() {
        let desk = Arc::new(Desk::default());
        let [mut first, mut second] = [(); 2].map(|()| desk.join().expect("a seat"));
        second.ask(wanted(5));
        let (seat, request) = desk.take(Duration::ZERO).expect("a request");
        desk.answer(seat, Answer::Refused { id: request.id, reason: String::new() });
        assert!(!first.answers.has_changed().expect("open") && second.answers.has_changed().expect("open"));
        assert!(matches!(&*second.answers.borrow_and_update(), Some(Answer::Refused { id: 5, .. })));
        assert!(first.answers.borrow_and_update().is_none());
    }
}
