//! Wishes and statements of where or how something should be, and facts about the initial scene.

use super::super::command::{Command, Group, Place};
use super::listener::Listener;
use super::verbs::{Class, is_verb};
use super::words::{is_mark, vocabulary};

impl Listener {
    /// Parses `I want the mug on the plate`, `make sure the tap is off`, `could the glass go to the left of the jug`.
    pub(super) fn wish(&mut self) -> Option<Vec<Command>> {
        // `grandma needs her mug on the tray`
        if self.take_any(&vocabulary().wishes).is_none() {
            let verbs =
                ["needs", "wants", "need", "want", "would like", "would love", "would prefer", "prefers", "likes"];
            let wants = |index: usize| verbs.iter().find_map(|verb| self.at_index(index, verb));
            let start = self.mind.next;
            let (index, length) = (start + 1..start + 4).find_map(|index| Some((index, wants(index)?)))?;
            self.mind.next = index + length;
            let follows = self.ahead(0);
            (!self.is_end(self.mind.next) && follows != "to" && !follows.ends_with("ing")).then_some(())?;
        }
        let commands = self.wanted(false)?;
        self.mind.wished = Some(self.mind.next);
        Some(commands)
    }

    /// True after `I want the tap off and`.
    fn goes_on_wishing(&self) -> bool {
        let before = self.mind.next.wrapping_sub(1);
        self.mind.wished == Some(before) && self.token(before) == "and"
    }

    /// Parses what is wanted: an object and its place or state; `is_duty` demands a word such as `should` between them.
    pub(super) fn wanted(&mut self, is_duty: bool) -> Option<Vec<Command>> {
        self.mind.source = None;
        self.take("that");
        let state = self.attempt(|listener| {
            let objects = listener.changed_objects()?;
            let start = listener.mind.next;
            listener.copula();
            (!is_duty || listener.is_duty(start)).then_some(())?;
            let action = listener.wanted_state()?;
            listener.changes(&objects, action)
        });
        if state.is_some() {
            return state;
        }
        let first = self.mind.next;
        let mut subjects = self.noun_phrases()?;
        let start = self.mind.next;
        self.copula();
        (!is_duty || self.is_duty(start)).then_some(())?;
        // `I want the mug standing on the tray`
        let is_named_again = self.tokens[self.mind.next..].iter().any(|word| word == "it" || word == "them");
        // `I need the sponge; could you put it …`
        let is_bare = subjects.iter().all(|subject| subject.at.is_none()) && self.at_boundary() && !self.at_result();
        if is_bare && is_named_again && !is_duty {
            self.mind.pending.clone_from(&subjects);
            self.remember(subjects);
            return Some(Vec::new());
        }
        if let [subject] = subjects.as_mut_slice()
            && self.at_boundary()
            && let Some(place) = subject.at.take()
        {
            return self.put(subjects, vec![*place]);
        }
        self.goal(&mut subjects, first)
    }

    /// Parses `the toy car should be parked behind the cube`, `the eggs go in the pan`, `the oven needs closing`.
    pub(super) fn statement(&mut self) -> Option<Vec<Command>> {
        let goes_on = self.goes_on_wishing();
        let commands = self.wanted(!goes_on)?;
        self.mind.wished = Some(self.mind.next).filter(|_| goes_on || self.is_gapped());
        Some(commands)
    }

    /// True if `and` comes next with a clause that shares its verb with this one: `… should be opened and the die put inside`.
    fn is_gapped(&self) -> bool {
        let start = self.mind.next + 1;
        let end = (start..self.tokens.len()).find(|&index| is_mark(self.token(index))).unwrap_or(self.tokens.len());
        let clause = &self.tokens[start.min(end)..end];
        let states = |word: &String| ["is", "are", "was", "were", "has", "have"].contains(&word.as_str());
        self.ahead(0) == "and" && !clause.iter().any(states)
    }

    /// True if a word since an index makes a statement a request.
    pub(super) fn is_duty(&self, start: usize) -> bool {
        self.tokens[start..self.mind.next].iter().any(|word| vocabulary().duties.contains(&word.as_str()))
    }

    /// Skips the words between an object and its place or state.
    pub(super) fn copula(&mut self) {
        loop {
            let word = self.ahead(0);
            let is_place = super::places::begins(self);
            let is_verb = Class::Carry.base(word).is_some()
                && word != "left"
                && !(self.at("put on").is_some() && self.is_end(self.mind.next + 2));
            if is_place || !(vocabulary().copulas.contains(&word) || is_verb) {
                return;
            }
            self.mind.next += 1;
        }
    }

    /// Requested places or states of objects.
    pub(super) fn goal(&mut self, subjects: &mut Vec<Group>, start: usize) -> Option<Vec<Command>> {
        if let Some(action) = self.attempt(Self::wanted_state) {
            return self.changes(subjects, action);
        }
        self.come_from(subjects)?;
        self.copula();
        if self.attempt(|listener| listener.taken_first(subjects)).is_some() {
            self.copula();
        }
        if self.mind.source.is_some() && self.at_boundary() {
            return self.put(std::mem::take(subjects), vec![Place::table()]);
        }
        if let Some(commands) = self.attempt(|listener| listener.either_side(subjects, start)) {
            return Some(commands);
        }
        if let Some(commands) = self.attempt(|listener| listener.mutual(subjects)) {
            return Some(commands);
        }
        let places = self.attempt(Self::places)?;
        self.come_from(subjects)?;
        self.put(std::mem::take(subjects), places)
    }

    /// Skips `picked up and` before the rest of what is to be done with an object.
    fn taken_first(&mut self, subjects: &mut [Group]) -> Option<()> {
        Class::Take.base(self.ahead(0)).filter(|_| !is_mark(self.ahead(1)))?;
        self.mind.next += 1;
        self.take_any(&["up", "from there"]);
        self.come_from(subjects)?;
        if super::places::begins(self) {
            return Some(());
        }
        self.take_any(&["and then", "and", ", then", ","])?;
        while self.take_any(&["is", "are", "to", "be", "should", "must"]).is_some() {}
        Class::Carry.base(self.ahead(0)).map(|_| ())
    }

    /// Parses a fact about the initial scene: `the potato is already in the pot`, `I left the apple in the bowl`, `the
    /// microwave is open`.
    pub(super) fn given(&mut self) -> Option<Vec<Command>> {
        let goes_on = self.goes_on_wishing();
        let is_there = self.take_any(&["there is already", "there is", "there are", "here is"]).is_some()
            || self.attempt(Self::past).is_some();
        let is_left = self.take_any(&["do not leave", "do not keep"]).is_some();
        let is_there = is_there || is_left;
        let is_with = !is_there && self.take("with");
        let mut group = self.noun_phrase()?;
        if is_with {
            self.wanted_state()?;
            self.remember(vec![group]);
            return Some(Vec::new());
        }
        if !is_there {
            (!goes_on).then_some(())?;
            let start = self.mind.next;
            while self.take_any(&vocabulary().being).is_some() {}
            (self.mind.next > start).then_some(())?;
            if self.attempt(Self::wanted_state).is_some() {
                self.remember(vec![group]);
                return Some(Vec::new());
            }
        }
        if group.at.is_none() {
            self.skip_modifiers();
            group.at = self.standing()?.map(Box::new);
        }
        let mut groups = vec![group];
        // `there is an apple in the bowl and a pear on the tray`
        while let Some(more) = self.attempt(|listener| {
            listener.take_any(&["and", ","])?;
            let group = listener.noun_phrase()?;
            let at = listener.standing()?.map(Box::new);
            listener.at_boundary().then_some(Group { at, ..group })
        }) {
            groups.push(more);
        }
        if is_left {
            self.mind.pending.clone_from(&groups);
        }
        self.remember(groups.clone());
        Some(groups.into_iter().map(Command::Given).collect())
    }

    /// Skips `I have left`, `somebody put` and the like.
    fn past(&mut self) -> Option<()> {
        let who = self.take_any(&["i", "we", "he", "she", "they", "someone", "somebody", "you will", "you can"])?;
        let has = self.take_any(&["have", "has", "had", "just", "already", "have just", "have already"]).is_some();
        self.take_any(&["accidentally", "just", "already"]);
        let verbs =
            ["left", "forgot", "forgotten", "found", "see", "find", "keep", "got", "noticed", "dropped", "stored"];
        if self.take_any(&verbs).is_none() {
            (has && !who.starts_with("you")).then_some(())?;
            self.take_any(&["put", "placed", "set", "kept", "laid"]);
        }
        Some(())
    }

    /// Parses a place before its object: `onto the tray goes the mug`, `in the bowl there is an apple`, `from the tray,
    /// take the mug`.
    pub(super) fn inverted(&mut self) -> Option<Vec<Command>> {
        if super::sources::is_source(self, self.mind.next) {
            let source = self.source()?;
            self.take(",");
            self.mind.fronted = source;
            let commands = self.attempt(Self::take_up).or_else(|| self.attempt(Self::carry));
            self.mind.fronted = None;
            return commands;
        }
        if !super::places::begins(self) {
            return None;
        }
        let start = self.mind.next;
        let mut places = self.places()?;
        // `behind the teapot is where the sugar belongs`
        if self.take_any(&["is where", "that is where", ", that is where"]).is_some() {
            let subjects = self.noun_phrases()?;
            let start = self.mind.next;
            self.copula();
            self.is_duty(start).then_some(())?;
            return self.put(subjects, places);
        }
        let is_listed = self.take(",") && self.is_determined(self.mind.next);
        let is_given = self
            .take_any(&[
                "there is",
                "there are",
                "you will find",
                "you find",
                "you can see",
                "you see",
                "i see",
                "is",
                "lies",
            ])
            .is_some();
        if is_given {
            let at = places.pop().filter(|place| !place.objects.is_empty()).map(Box::new);
            let group = Group { at, ..self.noun_phrase()? };
            self.remember(vec![group.clone()]);
            return Some(vec![Command::Given(group)]);
        }
        let before = self.mind.next;
        let is_told =
            self.take("with") || self.verb(Class::Carry).is_some() || self.take_any(&vocabulary().wishes).is_some();
        if !is_told {
            self.copula();
        }
        // `put the bread on the board and next to it the honey`
        let is_gapped = self.token(start.wrapping_sub(1)) == "and" && self.is_determined(before);
        (is_listed || self.mind.next > before || is_gapped).then_some(())?;
        let is_fact = !is_told && self.mind.next > before && !self.is_duty(before);
        let subjects = self.noun_phrases()?;
        // `in front of the teapot stands a mug`
        if let ([subject], [at], true) = (subjects.as_slice(), places.as_slice(), is_fact) {
            let group = Group { at: Some(Box::new(at.clone())), ..subject.clone() };
            self.remember(vec![group.clone()]);
            return Some(vec![Command::Given(group)]);
        }
        self.put(subjects, places)
    }

    /// Parses the name of an object before a request about it: `the red mug, put it …`, `you know the book?`
    pub(super) fn named(&mut self) -> Option<Vec<Command>> {
        let is_topic = self.take_any(&["you know", "see", "you see", "as for", "regarding", "about"]).is_some();
        let is_determined = self.is_determined(self.mind.next);
        let group = self.noun_phrase()?;
        let follows = self.ahead(1);
        let is_request = is_verb(follows) && self.ahead(0) == ","
            || is_determined && is_mark(self.ahead(0)) && (is_verb(follows) || vocabulary().polite.contains(&follows));
        let pronouns = ["it", "them", "that"];
        let is_used =
            is_request && self.tokens[self.mind.next + 1..].iter().any(|word| pronouns.contains(&word.as_str()));
        (is_used || is_topic && !self.is_done()).then_some(())?;
        self.mind.pending = vec![group.clone()];
        self.remember(vec![group]);
        Some(Vec::new())
    }

    /// Parses `which I'd like on the tray` after a fact about the object.
    pub(super) fn continued(&mut self) -> Option<Vec<Command>> {
        (self.mind.next > 0 && self.token(self.mind.next - 1) == "," && !self.mind.topic.is_empty()).then_some(())?;
        self.take("which").then_some(())?;
        let start = self.mind.next;
        let is_wish = self.take_any(&vocabulary().wishes).is_some();
        self.copula();
        (is_wish || self.is_duty(start)).then_some(())?;
        let commands = self.goal(&mut self.mind.topic.clone(), start)?;
        self.at_boundary().then_some(commands)
    }

    /// Parses `where is the puzzle cube?` before a request about it.
    pub(super) fn sought(&mut self) -> Option<Vec<Command>> {
        self.take_any(&["where is", "do you see", "can you see", "have you seen", "do you know"])?;
        let group = self.noun_phrase()?;
        (self.ahead(0) == "." && self.mind.next + 1 < self.tokens.len()).then_some(())?;
        self.mind.pending = vec![group.clone()];
        self.remember(vec![group]);
        Some(Vec::new())
    }

    /// Parses a phrase with a place or a state, without a verb: `the mug: left of the bowl`, `laptop closed`.
    pub(super) fn fragment(&mut self) -> Option<Vec<Command>> {
        let is_next = self.token(self.mind.next.wrapping_sub(1)) == "then" && self.is_determined(self.mind.next);
        let mut subjects = self.noun_phrases()?;
        // `then the apple, then the pear`
        let is_row = is_next && self.at_boundary() && subjects.iter().all(|subject| subject.at.is_none());
        if is_row || self.take_any(&vocabulary().likewise).is_some() {
            return self.again(subjects);
        }
        if let Some(action) = self.attempt(Self::wanted_state) {
            return self.changes(&subjects, action);
        }
        self.come_from(&mut subjects)?;
        self.attempt(|listener| {
            listener.take_any(&[",", "."])?;
            listener.skip_courtesies();
            listener.take_any(&["both", "all"]);
            super::places::begins(listener).then_some(())
        });
        let places = self.attempt(Self::places)?;
        // `the doughnut! Onto the plate with it!`
        self.take_any(&["with it", "with them"]);
        self.put(subjects, places)
    }
}
