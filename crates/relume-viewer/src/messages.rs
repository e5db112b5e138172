//! What the window has to say: errors stay until they are read.

use std::time::{Duration, Instant};

use relume::Error;

/// How long good news stays.
const GOOD_NEWS: Duration = Duration::from_secs(6);
/// Messages that are kept; of more, the oldest that are no errors go.
const MOST: usize = 20;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Something failed.
    Error,
    /// Something may surprise.
    Warning,
    /// Something went well; goes away by itself.
    Notice,
}

#[derive(Clone, Debug)]
pub(crate) struct Message {
    pub(crate) kind: Kind,
    pub(crate) text: String,
    since: Instant,
}

/// Messages, the newest last.
#[derive(Debug, Default)]
pub(crate) struct Messages(Vec<Message>);

impl Messages {
    fn add(&mut self, kind: Kind, text: String) {
        self.0.retain(|message| message.text != text);
        if self.0.len() >= MOST {
            // errors stay until they are read
            let oldest = [Kind::Notice, Kind::Warning]
                .into_iter()
                .find_map(|kind| self.0.iter().position(|message| message.kind == kind));
            oldest.map(|oldest| self.0.remove(oldest));
        }
        self.0.push(Message { kind, text, since: Instant::now() });
    }

    pub(crate) fn error(&mut self, error: &Error) {
        self.add(Kind::Error, error.to_string());
    }

    pub(crate) fn warn(&mut self, text: impl Into<String>) {
        self.add(Kind::Warning, text.into());
    }

    pub(crate) fn notice(&mut self, text: impl Into<String>) {
        self.add(Kind::Notice, text.into());
    }

    pub(crate) fn dismiss(&mut self, index: usize) {
        if index < self.0.len() {
            self.0.remove(index);
        }
    }

    /// Takes away what has been there for long enough, and says when to ask again.
    pub(crate) fn age(&mut self) -> Option<Duration> {
        self.0.retain(|message| message.kind != Kind::Notice || message.since.elapsed() < GOOD_NEWS);
        let notices = self.0.iter().filter(|message| message.kind == Kind::Notice);
        notices.map(|notice| GOOD_NEWS.saturating_sub(notice.since.elapsed())).min()
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &Message> {
        self.0.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_stay_and_good_news_goes() {
        let mut messages = Messages::default();
        messages.error(&Error::Setting("the disk is full".to_owned()));
        messages.notice("saved");
        messages.notice("saved");
        assert_eq!(messages.iter().count(), 2, "the same is said once");
        assert!(messages.age().is_some());
        messages.0.iter_mut().for_each(|message| message.since -= GOOD_NEWS);
        assert_eq!(messages.age(), None);
        assert_eq!(messages.iter().map(|message| message.kind).collect::<Vec<_>>(), [Kind::Error]);
        messages.dismiss(0);
        messages.dismiss(0);
        assert_eq!(messages.iter().count(), 0);
    }
}
