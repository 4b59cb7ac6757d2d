//! A loopback policy server for openpi's protocol with configurable faults, for tests.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use rmpv::Value;
use tungstenite::{Message, accept};

use crate::numpy::{Array, Numbers, get};

/// A request that the fake server received.
#[derive(Clone, Debug)]
pub struct Question {
    /// Index of the request over all connections, from 0.
    pub number: usize,
    /// Index of the request in its connection, from 0.
    pub in_connection: usize,
    map: Value,
}

impl Question {
    /// An array of the observation, e.g. `observation/state`.
    ///
    /// # Errors
    /// If the observation has no array of this name.
    pub fn array(&self, name: &str) -> Result<Array, String> {
        Array::read(get(&self.map, name).ok_or_else(|| format!("no `{name}`"))?)
    }

    /// Instruction of the request; `None` if it has none.
    pub fn prompt(&self) -> Option<&str> {
        get(&self.map, "prompt")?.as_str()
    }
}

/// Behaviour of the server for a request.
#[derive(Clone, Debug)]
pub enum Answer {
    /// Reply with an action chunk, row by row.
    Actions(Vec<Vec<f32>>),
    /// Reply with a map that contains no actions.
    Nothing,
    /// Reply with a traceback, as from a failed server.
    Traceback(String),
    /// Reply with arbitrary bytes.
    Bytes(Vec<u8>),
    /// Wait, then close the connection.
    Hangs(Duration),
    /// Close the connection.
    Drops,
}

/// Starts a server that runs as long as the program; it sends its metadata, then answers requests.
///
/// # Errors
/// Fails if there is no free port.
pub fn start(answering: impl Fn(&Question) -> Answer + Send + Sync + 'static) -> std::io::Result<SocketAddr> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let address = listener.local_addr()?;
    let (answering, asked) = (Arc::new(answering), Arc::new(AtomicUsize::new(0)));
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let (answering, asked) = (Arc::clone(&answering), Arc::clone(&asked));
            std::thread::spawn(move || serve(stream, &*answering, &asked));
        }
    });
    Ok(address)
}

fn serve(stream: TcpStream, answering: &dyn Fn(&Question) -> Answer, asked: &AtomicUsize) -> Option<()> {
    let mut socket = accept(stream).ok()?;
    let metadata = Value::Map(vec![("model_name".into(), "fake".into())]);
    socket.send(Message::binary(packed(&metadata)?)).ok()?;
    let mut in_connection = 0;
    while let Ok(Message::Binary(question)) = socket.read() {
        let map = rmpv::decode::read_value(&mut question.as_ref()).ok()?;
        let number = asked.fetch_add(1, Ordering::SeqCst);
        let message = match answering(&Question { number, in_connection, map }) {
            Answer::Actions(rows) => Message::binary(packed(&actions(&rows))?),
            Answer::Nothing => Message::binary(packed(&Value::Map(Vec::new()))?),
            Answer::Traceback(text) => Message::text(text),
            Answer::Bytes(bytes) => Message::binary(bytes),
            Answer::Hangs(time) => {
                std::thread::sleep(time);
                return None;
            }
            Answer::Drops => return None,
        };
        socket.send(message).ok()?;
        in_connection += 1;
    }
    Some(())
}

fn actions(rows: &[Vec<f32>]) -> Value {
    let shape = vec![rows.len(), rows.first().map_or(8, Vec::len)];
    let actions = Array { shape, numbers: Numbers::F32(rows.concat()) };
    Value::Map(vec![("actions".into(), actions.value()), ("server_timing".into(), Value::Map(Vec::new()))])
}

fn packed(value: &Value) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    rmpv::encode::write_value(&mut bytes, value).ok()?;
    Some(bytes)
}
