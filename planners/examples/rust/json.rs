//! The part of JSON that docs/planner_protocol.md needs: values from a line.
use std::collections::HashMap;

pub enum Value {
    None,
    Number(f64), // and booleans
    Text(String),
    List(Vec<Value>),
    Map(HashMap<String, Value>),
}

impl Value {
    pub fn get(&self, key: &str) -> &Value {
        match self {
            Value::Map(map) => map.get(key).unwrap_or(&Value::None),
            _ => &Value::None,
        }
    }
    pub fn number(&self) -> f64 {
        if let Value::Number(number) = self { *number } else { f64::NAN }
    }
    pub fn text(&self) -> &str {
        if let Value::Text(text) = self { text } else { "" }
    }
    pub fn list(&self) -> &[Value] {
        if let Value::List(list) = self { list } else { &[] }
    }
    pub fn numbers(&self) -> Vec<f64> {
        self.list().iter().map(Value::number).collect()
    }
}

pub struct Reader<'a> {
    data: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    pub fn new(line: &'a str) -> Self {
        Reader { data: line.as_bytes(), at: 0 }
    }
    fn next(&mut self) -> u8 {
        while self.data[self.at].is_ascii_whitespace() {
            self.at += 1;
        }
        self.data[self.at]
    }
    fn goes_on(&mut self, end: u8) -> bool {
        let found = self.next();
        if found == b',' || found == end {
            self.at += 1;
        }
        found != end
    }
    pub fn value(&mut self) -> Value {
        match self.next() {
            b'{' => {
                let mut map = HashMap::new();
                self.at += 1;
                while self.goes_on(b'}') {
                    self.next();
                    let key = self.string();
                    self.next();
                    self.at += 1; // the colon
                    map.insert(key, self.value());
                }
                Value::Map(map)
            }
            b'[' => {
                let mut list = Vec::new();
                self.at += 1;
                while self.goes_on(b']') {
                    list.push(self.value());
                }
                Value::List(list)
            }
            b'"' => Value::Text(self.string()),
            _ => {
                let begin = self.at;
                while self.at < self.data.len() && !b",]} \n\r\t".contains(&self.data[self.at]) {
                    self.at += 1;
                }
                match std::str::from_utf8(&self.data[begin..self.at]).unwrap_or("") {
                    "null" => Value::None,
                    "true" => Value::Number(1.0),
                    "false" => Value::Number(0.0),
                    number => Value::Number(number.parse().expect("a number")),
                }
            }
        }
    }
    fn string(&mut self) -> String {
        let mut bytes = Vec::new();
        self.at += 1;
        while self.data[self.at] != b'"' {
            if self.data[self.at] == b'\\' {
                self.at += 1; // ids and names hold nothing that needs more than this
            }
            bytes.push(self.data[self.at]);
            self.at += 1;
        }
        self.at += 1;
        String::from_utf8_lossy(&bytes).into_owned()
    }
}
