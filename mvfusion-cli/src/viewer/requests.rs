//! The requests of pages, which a single thread renders.
//!
//! Each page has a slot for one request: a newer one takes the place of an older one that nobody has begun. Pages take
//! turns. Nothing here grows with the number of messages.

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use super::frame::Answer;
use super::protocol::FrameRequest;

/// Most pages at a time.
pub const MOST_PAGES: usize = 8;

/// The requests, shared by the server and the thread that renders.
#[derive(Debug, Default)]
pub struct RequestQueue {
    state: Mutex<State>,
    /// Notified of every new request and command.
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    clients: BTreeMap<ClientId, ClientSlot>,
    next: u64,
    /// The client that was served last.
    served: ClientId,
    commands: Commands,
}

/// The number of a client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct ClientId(u64);

#[derive(Debug)]
struct ClientSlot {
    waiting: Option<Box<FrameRequest>>,
    answer: watch::Sender<Option<Answer>>,
}

/// What pages have asked the training to do since the last look. Of contrary commands, the last one counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Commands {
    /// Pause, or go on.
    pub pause: Option<bool>,
    /// Save a checkpoint.
    pub checkpoint: bool,
}

/// A page's side of the queue. Dropping it frees its slot.
#[derive(Debug)]
pub struct Client {
    requests: Arc<RequestQueue>,
    id: ClientId,
    /// The newest answer.
    pub answers: watch::Receiver<Option<Answer>>,
}

impl RequestQueue {
    /// A slot for a new page; `None` if all are taken.
    pub fn connect(self: &Arc<Self>) -> Option<Client> {
        let mut state = self.state();
        if state.clients.len() >= MOST_PAGES {
            return None;
        }
        state.next += 1;
        let id = ClientId(state.next);
        let (answer, answers) = watch::channel(None);
        state.clients.insert(id, ClientSlot { waiting: None, answer });
        Some(Client { requests: Arc::clone(self), id, answers })
    }

    /// Number of pages.
    pub fn pages(&self) -> usize {
        self.state().clients.len()
    }

    /// Whether a request waits.
    pub fn is_asked(&self) -> bool {
        self.state().clients.values().any(|slot| slot.waiting.is_some())
    }

    /// Takes the next request, in turns among the pages. Waits for one, or for a command, at most for `timeout`.
    pub fn take(&self, timeout: Duration) -> Option<(ClientId, Box<FrameRequest>)> {
        let mut state = self.state();
        if let Some(found) = state.take() {
            return Some(found);
        }
        if !timeout.is_zero() && state.commands == Commands::default() {
            (state, _) = self.changed.wait_timeout(state, timeout).unwrap_or_else(PoisonError::into_inner);
        }
        state.take()
    }

    /// Answers a page, if it is still there.
    pub fn answer(&self, id: ClientId, answer: Answer) {
        if let Some(slot) = self.state().clients.get(&id) {
            slot.answer.send_replace(Some(answer));
        }
    }

    /// The commands since the last call.
    pub fn take_commands(&self) -> Commands {
        std::mem::take(&mut self.state().commands)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A panic elsewhere leaves slots and commands sound: each change is one assignment.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn take(&mut self) -> Option<(ClientId, Box<FrameRequest>)> {
        let served = self.served;
        let waiting = |(id, slot): (&ClientId, &ClientSlot)| slot.waiting.is_some().then_some(*id);
        let after = self.clients.iter().filter(|(id, _)| **id > served).find_map(waiting);
        let next = after.or_else(|| self.clients.iter().find_map(waiting))?;
        self.served = next;
        let request = self.clients.get_mut(&next)?.waiting.take()?;
        Some((next, request))
    }
}

impl Client {
    /// Asks for a picture, instead of the one that was asked for before and not yet begun.
    pub fn ask(&self, request: Box<FrameRequest>) {
        if let Some(slot) = self.requests.state().clients.get_mut(&self.id) {
            slot.waiting = Some(request);
        }
        self.requests.changed.notify_one();
    }

    /// Asks for a pause, or that the training goes on.
    pub fn request_pause(&self, is_paused: bool) {
        self.requests.state().commands.pause = Some(is_paused);
        self.requests.changed.notify_one();
    }

    /// Asks for a checkpoint.
    pub fn request_checkpoint(&self) {
        self.requests.state().commands.checkpoint = true;
        self.requests.changed.notify_one();
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.requests.state().clients.remove(&self.id);
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

    fn taken(requests: &RequestQueue) -> Option<u64> {
        requests.take(Duration::ZERO).map(|(_, request)| request.id)
    }

    #[test]
    fn the_newest_request_of_a_page_wins() {
        let requests = Arc::new(RequestQueue::default());
        let page = requests.connect().expect("a slot");
        (0..1000).for_each(|id| page.ask(wanted(id)));
        assert!(requests.is_asked());
        assert_eq!((taken(&requests), taken(&requests)), (Some(999), None));
    }

    #[test]
    fn pages_take_turns_however_much_one_asks() {
        let requests = Arc::new(RequestQueue::default());
        let [greedy, modest] = [(); 2].map(|()| requests.connect().expect("a slot"));
        modest.ask(wanted(1000));
        let served: Vec<u64> = (0..3)
            .filter_map(|id| {
                greedy.ask(wanted(id));
                taken(&requests)
            })
            .collect();
        assert_eq!(served, [0, 1000, 2]);
    }

    #[test]
    fn slots_are_few_and_come_back() {
        let requests = Arc::new(RequestQueue::default());
        let pages: Vec<Client> = (0..MOST_PAGES).map(|_| requests.connect().expect("a slot")).collect();
        assert!(requests.connect().is_none());
        drop(pages);
        assert_eq!(requests.pages(), 0);
        assert!(requests.connect().is_some());
    }

    #[test]
    fn the_request_of_a_page_that_has_left_is_forgotten() {
        let requests = Arc::new(RequestQueue::default());
        let page = requests.connect().expect("a slot");
        page.ask(wanted(1));
        let (client, _) = requests.take(Duration::ZERO).expect("a request");
        drop(page);
        requests.answer(client, Answer::Refused { id: 1, reason: "nobody hears it".to_owned() });
        assert_eq!(taken(&requests), None);
    }

    #[test]
    fn commands_are_taken_once_and_the_last_one_counts() {
        let requests = Arc::new(RequestQueue::default());
        let page = requests.connect().expect("a slot");
        page.request_pause(true);
        page.request_pause(false);
        page.request_checkpoint();
        assert_eq!(requests.take_commands(), Commands { pause: Some(false), checkpoint: true });
        assert_eq!(requests.take_commands(), Commands::default());
    }

    #[test]
    fn an_answer_reaches_its_page_alone() {
        let requests = Arc::new(RequestQueue::default());
        let [mut first, mut second] = [(); 2].map(|()| requests.connect().expect("a slot"));
        second.ask(wanted(5));
        let (client, request) = requests.take(Duration::ZERO).expect("a request");
        requests.answer(client, Answer::Refused { id: request.id, reason: String::new() });
        assert!(!first.answers.has_changed().expect("open") && second.answers.has_changed().expect("open"));
        assert!(matches!(&*second.answers.borrow_and_update(), Some(Answer::Refused { id: 5, .. })));
        assert!(first.answers.borrow_and_update().is_none());
    }
}
