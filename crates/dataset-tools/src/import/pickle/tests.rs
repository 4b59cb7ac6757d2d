use super::*;

const PLAIN: &[u8] = include_bytes!("../../../testdata/original/meta_info.pkl");

#[test]
fn values_of_a_real_pickle_are_read() {
    let pickle = Pickle::read(PLAIN).unwrap();
    let root = pickle.root();
    assert_eq!(root.get("num_steps").and_then(Value::integer), Some(5));
    assert_eq!(root.get("language_instruction").and_then(Value::text), Some("Put the mug on the plate."));
    let mug = root.get("task_data").and_then(|task| task.get("initial_layout")?.get("mug_7")).unwrap();
    assert_eq!(mug.get("position").and_then(Value::numbers), Some((vec![0.5], true)), "a NumPy scalar");
    assert_eq!(mug.get("orientation").and_then(Value::numbers), Some((vec![0.0, 1.0, 0.0, 0.0], false)));
    assert_eq!(root.get("keys").and_then(|keys| keys.get("json_data")?.entries()?[0].bytes()), Some(&b"json_data"[..]));
    assert!(root.get("absent").is_none() && root.text().is_none());
}

/// Numbers of the root value of a pickle, see [`Value::numbers`].
fn numbers(bytes: &[u8]) -> Vec<f64> {
    Pickle::read(bytes).unwrap().root().numbers().unwrap().0
}

/// Python's encodings of `[1, 2.5, True, -3]` in several protocols, and of NumPy arrays, are read.
#[test]
fn every_protocol_is_read() {
    let cases: [(&[u8], &[f64]); 5] = [
        (b"(lp0\nI1\naF2.5\naI01\naI-3\na.", &[1.0, 2.5, 1.0, -3.0]),
        (b"\x80\x02]q\x00(K\x01G@\x04\x00\x00\x00\x00\x00\x00\x88J\xfd\xff\xff\xffe.", &[1.0, 2.5, 1.0, -3.0]),
        (b"\x80\x04\x95\x14\x00\x00\x00\x00\x00\x00\x00]\x94(K\x01G@\x04\x00\x00\x00\x00\x00\x00\x88J\xfd\xff\xff\xffe.", &[1.0, 2.5, 1.0, -3.0]),
        // numpy.array([1, -2], "i2") in protocol 2, which encodes bytes as text.
        (
            b"\x80\x02cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85c_codecs\nencode\nX\x01\x00\x00\x00bX\x06\x00\x00\x00latin1\x86R\x87R(K\x01K\x02\x85cnumpy\ndtype\nX\x02\x00\x00\x00i2\x89\x88\x87R(K\x03X\x01\x00\x00\x00<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89c_codecs\nencode\nX\x06\x00\x00\x00\x01\x00\xc3\xbe\xc3\xbfX\x06\x00\x00\x00latin1\x86Rtb.",
            &[1.0, -2.0],
        ),
        // numpy.array([0.5], "f4") in protocol 5, by NumPy 2.
        (
            b"\x80\x05\x8c\x13numpy._core.numeric\x94\x8c\x0b_frombuffer\x94\x93\x94(\x96\x04\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x3f\x94\x8c\x05numpy\x94\x8c\x05dtype\x94\x93\x94\x8c\x02f4\x94\x89\x88\x87\x94R\x94(K\x03\x8c\x01<\x94NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00t\x94bK\x01\x85\x94\x8c\x01C\x94t\x94R\x94.",
            &[0.5],
        ),
    ];
    for (bytes, expected) in cases {
        assert_eq!(numbers(bytes), expected, "{}", String::from_utf8_lossy(bytes));
    }
}

/// Calls of other functions, memory bombs and deep nesting are rejected with a one-line error.
#[test]
fn hostile_pickles_are_rejected() {
    let deep = [vec![b'('; 100_000], b".".to_vec()].concat();
    let wide = [b"N".to_vec(), vec![b'2'; 4_000_001], b".".to_vec()].concat();
    let cases: [(&[u8], &str); 17] = [
        (&wide, "at most 4000000 values on the stack"),
        (b"cos\nsystem\n(S'id'\ntR.", "got a call of os.system, which is not executed"),
        (b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x02id\x85R.", "got a call of posix.system, which is not executed"),
        (b"\x80\x04\x8c\x08builtins\x8c\x04eval\x93\x8c\x011\x85R.", "got a call of builtins.eval"),
        (b"\x80\x04\x8c\x02os\x8c\x06system\x93.", "got a call of os.system"),
        (b"ios\nsystem\n.", "expected an opcode that builds plain values, got 0x69"),
        (b"\x80\x04}\x81.", "expected an opcode that builds plain values, got 0x81"),
        (b"P1\n.", "expected an opcode"),
        (b"\x80\x05\x97.", "expected an opcode"),
        (&deep, "nested at most 1000 deep"),
        (b"B\xff\xff\xff\xff.", "expected 4294967295 more bytes, got the end"),
        (b"\x8e\xff\xff\xff\xff\xff\xff\xff\xff.", "more bytes, got the end"),
        (b"\x8a\xffK", "at most 8 bytes"),
        (b"h\x07.", "expected a value at memo index 7, got none"),
        (b"K\x01K\x02a.", "expected a list to append to"),
        (
            b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85C\x01b\x87R(K\x01J\xff\xff\xff\x7f\x85cnumpy\ndtype\n\x8c\x02f8\x89\x88\x87R\x89C\x08\0\0\0\0\0\0\0\0tb.",
            "bytes for an array of shape [2147483647], got 8",
        ),
        (b"", "expected 1 more bytes, got the end"),
    ];
    for (bytes, expected) in cases {
        let error = Pickle::read(bytes).unwrap_err();
        assert!(error.contains(expected) && !error.contains('\n'), "{expected} in {error}");
    }
}

/// Exponentially nested shared lists: ten billion values by reference, a hundred in memory.
#[test]
fn shared_values_are_not_copied() {
    let mut bomb = b"]\x94K\x01aK\x01a".to_vec();
    for level in 1..34_u8 {
        // [previous, previous], memoised.
        bomb.extend([b']', 0x94, b'h', level - 1, b'a', b'h', level - 1, b'a']);
    }
    bomb.push(b'.');
    let pickle = Pickle::read(&bomb).unwrap();
    assert!(pickle.values.len() < 200);
    assert_eq!(pickle.root().numbers(), None, "too deep for numbers");
    // A list that contains itself.
    let pickle = Pickle::read(b"]\x94h\x00a.").unwrap();
    assert_eq!((pickle.root().entries().unwrap().len(), pickle.root().numbers()), (1, None));
}

/// Randomly changed, truncated or swapped bytes give a value or an error, never a panic.
#[test]
fn corrupted_pickles_never_panic() {
    let mut state = 781_000_u64;
    let mut draw = move |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut refused = 0;
    for _ in 0..20_000 {
        let mut bytes = PLAIN.to_vec();
        for _ in 0..=draw(4) {
            let at = draw(bytes.len());
            bytes[at] = draw(256) as u8;
        }
        bytes.truncate(1 + draw(bytes.len()));
        match Pickle::read(&bytes) {
            Ok(pickle) => drop(pickle.root().get("task_data").and_then(Value::numbers)),
            Err(why) => refused += usize::from(why.starts_with("expected")),
        }
    }
    assert!(refused > 15_000, "{refused}");
}
