//! Chat model shared by parallel episodes. It lends the thread's core to others while waiting, counts tokens and cost,
//! and stops at a cost limit.

use std::collections::BTreeMap;
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::ScopedJoinHandle;

use genmanip_agent::ask::ChatService;
use genmanip_core::{Seed, limits};
use genmanip_llm::{
    CassetteChat, CassetteMode, CassetteSettings, ChatError, ChatModel, ChatReply, ChatRequest, Cost, FolderChat,
    FolderSettings, Ledger, Price, ServerSettings, SettingsError,
};
use genmanip_rollout::Cores;
use serde::Deserialize;

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Settings file of a model: the tables `server`, `folder`, `cassettes` and `prices`, as for task design.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelFile {
    /// Server that answers.
    pub server: ServerSettings,
    /// Exchange folder through which a person or program answers instead of the server; `None` for the server.
    pub folder: Option<FolderSettings>,
    /// Recording and replay of answers.
    pub cassettes: CassetteSettings,
    /// Token prices by model name.
    pub prices: BTreeMap<String, Price>,
}

impl ModelFile {
    /// Reads a settings file of a model.
    ///
    /// # Errors
    /// An unreadable or invalid file; values are never shown, since the file may contain a key.
    pub fn read(path: &Path) -> Result<Self, WorkspaceError> {
        let text = documents::read_text(path, limits::SETTINGS)?;
        let unusable =
            |error| WorkspaceError::input(format!("{} holds no settings of a model", path.display())).because(error);
        let file: Self = genmanip_llm::from_toml(&text).map_err(unusable)?;
        file.check().map_err(unusable)?;
        Ok(file)
    }

    fn check(&self) -> Result<(), SettingsError> {
        self.server.check()?;
        self.folder.iter().try_for_each(FolderSettings::check)?;
        self.prices.values().try_for_each(Price::check)
    }
}

/// Chat model that is opened once and shared by any number of episodes.
pub struct SharedModel {
    chat: Box<dyn ChatModel>,
    server: ServerSettings,
    account: Arc<UsageAccount>,
}

impl SharedModel {
    /// Opens the server, the folder or the recordings that the settings name.
    ///
    /// # Errors
    /// An invalid setting, or a missing key.
    pub fn open(file: &ModelFile) -> Result<Self, WorkspaceError> {
        let price = file.prices.get(&file.server.model).cloned();
        let account = Arc::new(UsageAccount { price, ..UsageAccount::default() });
        let paid = Arc::clone(&account);
        let chat: Result<Box<dyn ChatModel>, SettingsError> = match &file.folder {
            Some(folder) if file.cassettes.mode != CassetteMode::Replay => FolderChat::new(folder.clone())
                .map(|model| Box::new(CassetteChat::new(model, file.cassettes.clone(), None)) as Box<dyn ChatModel>),
            _ => CassetteChat::open_around(&file.server, &file.cassettes, Seed::new(0).fork("retries"), |model| Paid {
                model,
                account: paid,
            })
            .map(|chat| Box::new(chat) as Box<dyn ChatModel>),
        };
        let chat = chat.map_err(|error| WorkspaceError::input("the model cannot be used").because(error))?;
        Ok(Self { chat, server: file.server.clone(), account })
    }

    /// Account of usage and cost so far.
    pub fn account(&self) -> &Arc<UsageAccount> {
        &self.account
    }

    /// Chat service for an agent; while a request is pending, the thread's core is lent to other episodes.
    pub fn service(self: &Arc<Self>, cores: Option<&Arc<Cores>>) -> ChatService {
        let chat = Lending { shared: Arc::clone(self), cores: cores.cloned() };
        ChatService {
            chat: Arc::new(chat),
            model: self.server.model.clone(),
            parameters: self.server.parameters.clone(),
        }
    }

    fn asked(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        let reply = self.chat.chat(request)?;
        self.account.ledger().add(&request.model, &reply);
        Ok(reply)
    }
}

struct Lending {
    shared: Arc<SharedModel>,
    cores: Option<Arc<Cores>>,
}

impl ChatModel for Lending {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        self.lent(|| self.shared.asked(request))
    }

    fn chat_each(&self, requests: &[ChatRequest]) -> Vec<Result<ChatReply, ChatError>> {
        self.lent(|| {
            std::thread::scope(|scope| {
                let threads: Vec<_> =
                    requests.iter().map(|request| scope.spawn(|| self.shared.asked(request))).collect();
                let reply =
                    |thread: ScopedJoinHandle<'_, _>| thread.join().unwrap_or_else(|panic| resume_unwind(panic));
                threads.into_iter().map(reply).collect()
            })
        })
    }
}

impl Lending {
    fn lent<T>(&self, ask: impl FnOnce() -> T) -> T {
        match &self.cores {
            Some(cores) => cores.lend(ask),
            None => ask(),
        }
    }
}

/// Model that fails once the cost limit is reached. Replayed answers are free and do not pass through it.
struct Paid<M> {
    model: M,
    account: Arc<UsageAccount>,
}

impl<M: ChatModel> ChatModel for Paid<M> {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        match self.account.overspent() {
            Some(error) => Err(error),
            None => self.model.chat(request),
        }
    }
}

/// Account of a model's usage and cost.
#[derive(Debug, Default)]
pub struct UsageAccount {
    price: Option<Price>,
    /// Cost limit in the currency of the price; `None` for no limit.
    limit: Mutex<Option<f64>>,
    ledger: Mutex<Ledger>,
}

impl UsageAccount {
    /// Stops new requests once the cost reaches `limit`; pending requests are completed.
    ///
    /// # Errors
    /// A model without a price, since its cost is unknown.
    pub fn set_limit(&self, limit: f64) -> Result<(), WorkspaceError> {
        if self.price.is_none() {
            return Err(WorkspaceError::input("the settings of the model say no price, so its cost cannot be limited")
                .with_hint("expected [prices.\"MODEL\"] with input_per_million and output_per_million"));
        }
        *self.limit.lock().unwrap_or_else(PoisonError::into_inner) = Some(limit);
        Ok(())
    }

    /// Number of answers, tokens and cost so far in words; empty before the first answer.
    pub fn describe(&self) -> String {
        let ledger = self.ledger();
        let Some((_, sums)) = ledger.models.iter().next() else { return String::new() };
        let mut words = format!("{} asks", sums.answers + sums.replayed);
        if sums.replayed > 0 {
            words += &format!(" ({} recorded)", sums.replayed);
        }
        if sums.requests > sums.answers {
            words += &format!(", {} requests repeated", sums.requests - sums.answers);
        }
        words += &format!(", {} + {} tokens", sums.prompt_tokens, sums.completion_tokens);
        match self.cost(&ledger) {
            Some(Cost::Known { amount, currency }) => words += &format!(", {amount:.2} {currency}"),
            Some(Cost::Unknown) | None => {}
        }
        words
    }

    fn overspent(&self) -> Option<ChatError> {
        let limit = (*self.limit.lock().unwrap_or_else(PoisonError::into_inner))?;
        match self.cost(&self.ledger())? {
            Cost::Known { amount, currency } if amount >= limit => Some(ChatError::Spent { amount, limit, currency }),
            // Without token counts the cost is unknown, so the limit cannot be guaranteed.
            Cost::Unknown => Some(ChatError::Uncounted { limit }),
            Cost::Known { .. } => None,
        }
    }

    fn cost(&self, ledger: &Ledger) -> Option<Cost> {
        let prices = |model: &String| Some(BTreeMap::from([(model.clone(), self.price.clone()?)]));
        let model = ledger.models.keys().next()?;
        ledger.costs(&prices(model)?).remove(model)
    }

    fn ledger(&self) -> MutexGuard<'_, Ledger> {
        self.ledger.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use genmanip_llm::Message;
    use genmanip_llm::fake::{Behaviour, FakeServer};

    use super::*;

    fn ask(model: &Arc<SharedModel>, words: &str) -> Result<ChatReply, ChatError> {
        let service = model.service(None);
        service.chat.chat(&ChatRequest::new(&service.model, vec![Message::user(words)]))
    }

    #[test]
    fn nothing_is_asked_once_the_money_is_spent() {
        // Each answer of the fake server counts 100 + 10 tokens.
        let server = FakeServer::start(|_| Behaviour::Answer("yes".into())).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let text = format!(
            "[server]\nbase_url = \"{}\"\nmodel = \"m\"\n[cassettes]\nmode = \"record\"\nfolder = {:?}\n\
             [prices.m]\ninput_per_million = 10000.0\noutput_per_million = 0.0",
            server.base_url(),
            folder.path()
        );
        let path = folder.path().join("model.toml");
        std::fs::write(&path, text).unwrap();
        let file = ModelFile::read(&path).unwrap();
        let model = Arc::new(SharedModel::open(&file).unwrap());
        model.account().set_limit(1.5).unwrap();
        assert!(ask(&model, "first").is_ok() && ask(&model, "second").is_ok());
        let error = ask(&model, "third").unwrap_err().to_string();
        assert_eq!(error, "the cost of 2.00 USD has reached the limit of 1.50");
        assert!(ask(&model, "first").is_ok(), "what is recorded costs nothing");
        assert_eq!(model.account().describe(), "3 asks (1 recorded), 200 + 20 tokens, 2.00 USD");
        assert_eq!(server.seen().len(), 2);
        // A price is needed for a limit.
        let unpriced = ModelFile { prices: BTreeMap::new(), ..file };
        let error = SharedModel::open(&unpriced).unwrap().account().set_limit(1.0).unwrap_err();
        assert!(error.to_string().contains("say no price"), "{error}");
    }
}
