//! A reader of the subset of Python's pickle format that `torch.save` writes. Nothing is ever executed:
//! classes and calls stay names in the result.
//!
//! Values live in one arena and refer to each other by index, so shared parts cost nothing, nesting
//! needs no recursion, and memory is linear in the number of bytes read.

mod bytes;

use bytes::Bytes;
use std::collections::HashMap;

/// Index of a value in its [`Pickle`].
pub(super) type Id = usize;

/// One unpickled value.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// `None`, and anything else that plays no part in a checkpoint's tensors.
    Other,
    /// An integer or a boolean.
    Int(i64),
    /// A string.
    Text(String),
    /// A tuple or a list.
    Sequence(Vec<Id>),
    /// A dict or an `OrderedDict`, in order.
    Dict(Vec<(Id, Id)>),
    /// A class or function, `module.name`.
    Global(String),
    /// A persistent id: how torch refers to a storage.
    Persistent(Id),
    /// A call of a global, recorded but not made.
    Call(Id, Id),
}

/// All values of a pickle, and which of them is the result.
#[derive(Debug)]
pub(super) struct Pickle {
    values: Vec<Value>,
    root: Id,
}

impl Pickle {
    pub(super) fn root(&self) -> &Value {
        self.get(self.root)
    }

    pub(super) fn get(&self, id: Id) -> &Value {
        self.values.get(id).unwrap_or(&Value::Other)
    }

    /// Reads a pickle of protocol 2 to 5. An error says at which byte and why.
    pub(super) fn parse(bytes: &[u8]) -> Result<Pickle, String> {
        let mut reader = Reader {
            bytes: Bytes::new(bytes),
            values: Vec::new(),
            stack: Vec::new(),
            marks: Vec::new(),
            memo: HashMap::new(),
        };
        match reader.run() {
            Ok(root) => Ok(Pickle {
                values: reader.values,
                root,
            }),
            Err(reason) => Err(format!("byte {} of data.pkl: {reason}", reader.bytes.at())),
        }
    }
}

struct Reader<'a> {
    bytes: Bytes<'a>,
    values: Vec<Value>,
    stack: Vec<Id>,
    /// Stack heights at the marks.
    marks: Vec<usize>,
    memo: HashMap<u32, Id>,
}

impl Reader<'_> {
    fn run(&mut self) -> Result<Id, String> {
        loop {
            match self.bytes.byte()? {
                b'.' => return self.pop(),
                0x80 => drop(self.bytes.byte()?),
                0x95 => drop(self.bytes.take(8)?),
                b'(' => self.marks.push(self.stack.len()),
                b'0' => drop(self.pop()?),
                b'1' => drop(self.pop_mark()?),
                b'2' => {
                    let top = self.top()?;
                    self.stack.push(top);
                }
                b'N' => self.push(Value::Other),
                0x88 => self.push(Value::Int(1)),
                0x89 => self.push(Value::Int(0)),
                b'J' => {
                    let value = self.bytes.u32()? as i32;
                    self.push(Value::Int(value.into()));
                }
                b'K' => {
                    let value = self.bytes.byte()?;
                    self.push(Value::Int(value.into()));
                }
                b'M' => {
                    let value = u16::from_le_bytes(self.bytes.array()?);
                    self.push(Value::Int(value.into()));
                }
                0x8a => {
                    let length = self.bytes.byte()?;
                    let value = self.bytes.long(length.into())?;
                    self.push(Value::Int(value));
                }
                b'G' => {
                    self.bytes.take(8)?;
                    self.push(Value::Other);
                }
                b'X' => {
                    let length = self.bytes.u32()?;
                    let text = self.bytes.text(length as usize)?;
                    self.push(Value::Text(text.into()));
                }
                0x8c => {
                    let length = self.bytes.byte()?;
                    let text = self.bytes.text(length.into())?;
                    self.push(Value::Text(text.into()));
                }
                // Byte strings play no part in a checkpoint's tensors.
                b'T' | b'B' => {
                    let length = self.bytes.u32()?;
                    self.bytes.take(length as usize)?;
                    self.push(Value::Other);
                }
                b'U' | b'C' => {
                    let length = self.bytes.byte()?;
                    self.bytes.take(length.into())?;
                    self.push(Value::Other);
                }
                b')' | b']' => self.push(Value::Sequence(Vec::new())),
                b't' | b'l' => {
                    let items = self.pop_mark()?;
                    self.push(Value::Sequence(items));
                }
                count @ 0x85..=0x87 => {
                    let from = self.height_for(usize::from(count - 0x84))?;
                    let items = self.stack.split_off(from);
                    self.push(Value::Sequence(items));
                }
                b'a' => {
                    let item = self.pop()?;
                    self.append(vec![item])?;
                }
                b'e' => {
                    let items = self.pop_mark()?;
                    self.append(items)?;
                }
                b'}' => self.push(Value::Dict(Vec::new())),
                b'd' => {
                    let items = self.pop_mark()?;
                    self.push(Value::Dict(Vec::new()));
                    self.set(&items)?;
                }
                b's' => {
                    let from = self.height_for(2)?;
                    let items = self.stack.split_off(from);
                    self.set(&items)?;
                }
                b'u' => {
                    let items = self.pop_mark()?;
                    self.set(&items)?;
                }
                b'q' => {
                    let key = self.bytes.byte()?;
                    self.remember(key.into())?;
                }
                b'r' => {
                    let key = self.bytes.u32()?;
                    self.remember(key)?;
                }
                0x94 => self.remember(self.memo.len() as u32)?,
                b'h' => {
                    let key = self.bytes.byte()?;
                    self.recall(key.into())?;
                }
                b'j' => {
                    let key = self.bytes.u32()?;
                    self.recall(key)?;
                }
                b'c' => {
                    let (module, name) = (self.bytes.line()?, self.bytes.line()?);
                    self.push(Value::Global(format!("{module}.{name}")));
                }
                0x93 => {
                    let (name, module) = (self.pop()?, self.pop()?);
                    let (Value::Text(module), Value::Text(name)) =
                        (&self.values[module], &self.values[name])
                    else {
                        return Err("a class without a name".into());
                    };
                    let global = format!("{module}.{name}");
                    self.push(Value::Global(global));
                }
                b'R' | 0x81 => {
                    let (arguments, callable) = (self.pop()?, self.pop()?);
                    let is_dict = matches!(&self.values[callable], Value::Global(g) if g == "collections.OrderedDict");
                    self.push(if is_dict {
                        Value::Dict(Vec::new())
                    } else {
                        Value::Call(callable, arguments)
                    });
                }
                // The state set on an object plays no part here.
                b'b' => drop(self.pop()?),
                b'Q' => {
                    let id = self.pop()?;
                    self.push(Value::Persistent(id));
                }
                code => {
                    return Err(format!(
                        "opcode 0x{code:02x} is not one that checkpoints need"
                    ));
                }
            }
        }
    }

    fn push(&mut self, value: Value) {
        self.stack.push(self.values.len());
        self.values.push(value);
    }

    /// Height of the stack without its top `count` values, which may not reach below the last mark.
    fn height_for(&self, count: usize) -> Result<usize, String> {
        let floor = self.marks.last().copied().unwrap_or(0);
        let height = self
            .stack
            .len()
            .checked_sub(count)
            .filter(|&height| height >= floor);
        height.ok_or_else(|| "the stack is empty".into())
    }

    fn top(&self) -> Result<Id, String> {
        let height = self.height_for(1)?;
        Ok(self.stack[height])
    }

    fn pop(&mut self) -> Result<Id, String> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    fn pop_mark(&mut self) -> Result<Vec<Id>, String> {
        let mark = self.marks.pop().ok_or("a mark is missing")?;
        Ok(self.stack.split_off(mark))
    }

    /// Appends to the sequence on top; additions to objects that were not made are dropped.
    fn append(&mut self, items: Vec<Id>) -> Result<(), String> {
        let top = self.top()?;
        if let Value::Sequence(sequence) = &mut self.values[top] {
            sequence.extend(items);
        }
        Ok(())
    }

    fn set(&mut self, items: &[Id]) -> Result<(), String> {
        let (pairs, rest) = items.as_chunks::<2>();
        if !rest.is_empty() {
            return Err("a key without a value".into());
        }
        let top = self.top()?;
        if let Value::Dict(dict) = &mut self.values[top] {
            dict.extend(pairs.iter().map(|&[key, value]| (key, value)));
        }
        Ok(())
    }

    fn remember(&mut self, key: u32) -> Result<(), String> {
        let top = self.top()?;
        self.memo.insert(key, top);
        Ok(())
    }

    fn recall(&mut self, key: u32) -> Result<(), String> {
        let id = *self.memo.get(&key).ok_or("a reference to nothing")?;
        self.stack.push(id);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// `pickle.dumps({"a": (1, -2, 300, 70000, 1 << 40), "b": [None, True, "ü"], "c": 1.5}, protocol)`.
    const PROTOCOL_2: &[u8] = b"\x80\x02}q\x00(X\x01\x00\x00\x00aq\x01(K\x01J\xfe\xff\xff\xffM,\x01Jp\x11\x01\x00\x8a\x06\x00\x00\x00\x00\x00\x01tq\x02X\x01\x00\x00\x00bq\x03]q\x04(N\x88X\x02\x00\x00\x00\xc3\xbcq\x05eX\x01\x00\x00\x00cq\x06G?\xf8\x00\x00\x00\x00\x00\x00u.";
    const PROTOCOL_4: &[u8] = b"\x80\x04\x95?\x00\x00\x00\x00\x00\x00\x00}\x94(\x8c\x01a\x94(K\x01J\xfe\xff\xff\xffM,\x01Jp\x11\x01\x00\x8a\x06\x00\x00\x00\x00\x00\x01t\x94\x8c\x01b\x94]\x94(N\x88\x8c\x02\xc3\xbc\x94e\x8c\x01c\x94G?\xf8\x00\x00\x00\x00\x00\x00u.";

    #[test]
    fn reads_what_python_wrote() {
        for bytes in [PROTOCOL_2, PROTOCOL_4] {
            let pickle = Pickle::parse(bytes).expect("well formed");
            let Value::Dict(dict) = pickle.root() else {
                panic!("not a dict")
            };
            let keys: Vec<_> = dict
                .iter()
                .map(|&(key, _)| pickle.get(key).clone())
                .collect();
            assert_eq!(keys, ["a", "b", "c"].map(|k| Value::Text(k.into())));
            let items = |entry: usize| match pickle.get(dict[entry].1) {
                Value::Sequence(items) => items
                    .iter()
                    .map(|&i| pickle.get(i).clone())
                    .collect::<Vec<_>>(),
                other => panic!("{other:?}"),
            };
            assert_eq!(items(0), [1, -2, 300, 70000, 1 << 40].map(Value::Int));
            assert_eq!(
                items(1),
                [Value::Other, Value::Int(1), Value::Text("ü".into())]
            );
        }
    }

    #[test]
    fn calls_are_not_made() {
        // `os.system("true")` as a pickle would ask for it.
        let pickle = Pickle::parse(b"\x80\x02cos\nsystem\nX\x04\x00\x00\x00true\x85R.")
            .expect("well formed");
        let &Value::Call(callable, _) = pickle.root() else {
            panic!("not a call")
        };
        assert_eq!(pickle.get(callable), &Value::Global("os.system".into()));
    }

    #[test]
    fn a_doubling_bomb_stays_small() {
        let mut bytes = b"\x80\x02)".to_vec();
        for _ in 0..100_000 {
            bytes.extend(b"2\x86");
        }
        bytes.push(b'.');
        assert_eq!(
            Pickle::parse(&bytes).expect("well formed").values.len(),
            100_001
        );
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = Pickle::parse(&bytes);
        }

        #[test]
        fn no_flip_panics(at in 0..PROTOCOL_4.len(), value: u8, cut in 0..PROTOCOL_4.len()) {
            let mut bytes = PROTOCOL_4.to_vec();
            bytes[at] = value;
            let _ = Pickle::parse(&bytes);
            prop_assert!(Pickle::parse(&PROTOCOL_4[..cut]).is_err());
        }
    }
}
