//! Conditions over signals: `Motor and DB10.level > 50`, `"Ready lamp" or not M1.0`.

use ob1_access::{Item, value};
use ob1_model::DataType;

use crate::head::number;

/// Nested parentheses and `not`s at most.
const DEPTH: usize = 64;

/// A condition.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression(Node);

#[derive(Clone, Debug, PartialEq)]
enum Node {
    /// The signal at this place.
    Signal(usize),
    Constant(f64),
    Not(Box<Node>),
    And(Box<Node>, Box<Node>),
    Or(Box<Node>, Box<Node>),
    Compare(Box<Node>, Relation, Box<Node>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Relation {
    Equal,
    Unequal,
    Less,
    AtMost,
    More,
    AtLeast,
}

const RELATIONS: [(&str, Relation); 8] = [
    ("<>", Relation::Unequal),
    ("!=", Relation::Unequal),
    ("<=", Relation::AtMost),
    (">=", Relation::AtLeast),
    ("==", Relation::Equal),
    ("=", Relation::Equal),
    ("<", Relation::Less),
    (">", Relation::More),
];

#[derive(Clone, Debug, PartialEq)]
enum Token {
    /// A name or a number; true: it was in quotes.
    Word(String, bool),
    Relation(Relation),
    Open,
    Close,
}

impl Expression {
    /// Reads a condition; `find` gives the place of a signal among those that are recorded, by its name.
    ///
    /// # Errors
    /// What is wrong with it, in one sentence.
    pub fn parse(text: &str, find: &mut dyn FnMut(&str) -> Result<usize, String>) -> Result<Self, String> {
        let tokens = tokens(text)?;
        let mut parser = Parser { tokens: tokens.into_iter().peekable(), find, depth: 0 };
        let node = parser.either()?;
        match parser.tokens.next() {
            None => Ok(Self(node)),
            Some(_) => Err(format!("\"{text}\" goes on where a condition ends; join conditions by `and` or `or`")),
        }
    }

    /// Whether it holds for these values; false while a signal of it is not there.
    pub fn holds(&self, items: &[Item], bits: &dyn Fn(usize) -> Option<u32>) -> bool {
        value_of(&self.0, items, bits).is_some_and(|value| value != 0.0)
    }
}

fn value_of(node: &Node, items: &[Item], bits: &dyn Fn(usize) -> Option<u32>) -> Option<f64> {
    let of = |node| value_of(node, items, bits);
    let bit = |value| f64::from(u8::from(value));
    Some(match node {
        Node::Signal(at) => number(items.get(*at)?, bits(*at)?),
        Node::Constant(value) => *value,
        Node::Not(one) => bit(of(one)? == 0.0),
        Node::And(one, other) => bit(of(one)? != 0.0 && of(other)? != 0.0),
        Node::Or(one, other) => bit(of(one)? != 0.0 || of(other)? != 0.0),
        Node::Compare(one, relation, other) => {
            let (one, other) = (of(one)?, of(other)?);
            bit(match relation {
                Relation::Equal => one == other,
                Relation::Unequal => one != other,
                Relation::Less => one < other,
                Relation::AtMost => one <= other,
                Relation::More => one > other,
                Relation::AtLeast => one >= other,
            })
        }
    })
}

fn tokens(text: &str) -> Result<Vec<Token>, String> {
    let mut tokens = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let (token, after) = match first {
            '(' => (Token::Open, &rest[1..]),
            ')' => (Token::Close, &rest[1..]),
            '"' => {
                let (name, after) = rest[1..].split_once('"').ok_or("a name in quotes does not end")?;
                (Token::Word(name.into(), true), after)
            }
            _ => match RELATIONS.iter().find(|(sign, _)| rest.starts_with(sign)) {
                Some((sign, relation)) => (Token::Relation(*relation), &rest[sign.len()..]),
                None => {
                    let ends = |c: char| c.is_whitespace() || "()<>=!\"".contains(c);
                    let (word, after) = rest.split_at(rest.find(ends).unwrap_or(rest.len()));
                    if word.is_empty() {
                        return Err(format!("\"{first}\" is not expected here; write `not` for the contrary"));
                    }
                    (Token::Word(word.into(), false), after)
                }
            },
        };
        tokens.push(token);
        rest = after.trim_start();
    }
    Ok(tokens)
}

struct Parser<'a> {
    tokens: std::iter::Peekable<std::vec::IntoIter<Token>>,
    find: &'a mut dyn FnMut(&str) -> Result<usize, String>,
    depth: usize,
}

impl Parser<'_> {
    fn keyword(&mut self, word: &str) -> bool {
        let is = |token: &Token| matches!(token, Token::Word(text, false) if text.eq_ignore_ascii_case(word));
        self.tokens.next_if(is).is_some()
    }

    fn either(&mut self) -> Result<Node, String> {
        let mut node = self.both()?;
        while self.keyword("or") {
            node = Node::Or(Box::new(node), Box::new(self.both()?));
        }
        Ok(node)
    }

    fn both(&mut self) -> Result<Node, String> {
        let mut node = self.one()?;
        while self.keyword("and") {
            node = Node::And(Box::new(node), Box::new(self.one()?));
        }
        Ok(node)
    }

    fn one(&mut self) -> Result<Node, String> {
        self.depth += 1;
        if self.depth > DEPTH {
            return Err(format!("more than {DEPTH} parentheses in each other"));
        }
        let node = if self.keyword("not") { Node::Not(Box::new(self.one()?)) } else { self.comparison()? };
        self.depth -= 1;
        Ok(node)
    }

    fn comparison(&mut self) -> Result<Node, String> {
        let one = self.operand()?;
        let Some(Token::Relation(relation)) = self.tokens.next_if(|token| matches!(token, Token::Relation(_))) else {
            return Ok(one);
        };
        let other = self.operand()?;
        Ok(Node::Compare(Box::new(one), relation, Box::new(other)))
    }

    fn operand(&mut self) -> Result<Node, String> {
        match self.tokens.next() {
            Some(Token::Open) => {
                let node = self.either()?;
                match self.tokens.next() {
                    Some(Token::Close) => Ok(node),
                    _ => Err("a parenthesis is not closed".into()),
                }
            }
            Some(Token::Word(word, quoted)) => match constant(&word).filter(|_| !quoted) {
                Some(value) => Ok(Node::Constant(value)),
                None => Ok(Node::Signal((self.find)(&word)?)),
            },
            _ => Err("a signal or a number is missing; write it like `Motor and DB10.level > 50`".into()),
        }
    }
}

/// A number as STL has it.
fn constant(word: &str) -> Option<f64> {
    match word.to_ascii_lowercase().as_str() {
        "true" => return Some(1.0),
        "false" => return Some(0.0),
        _ => {}
    }
    let first = word.trim_start_matches(['-', '+']).chars().next()?;
    if !first.is_ascii_digit() && !word.contains('#') {
        return None;
    }
    let item = Item {
        name: word.into(),
        cell: ob1_model::Cell::Peripheral(0),
        width: ob1_model::Width::DWord,
        reading: ob1_access::Reading::Signed,
        ty: DataType::DInt,
    };
    let whole = value::from_text(&item, word).ok().map(|bits| f64::from(bits as i32));
    // Times compare by their milliseconds, as the bits of TIME do.
    whole.or_else(|| word.parse().ok()).or_else(|| {
        let time = Item { ty: DataType::Time, ..item };
        value::from_text(&time, word).ok().map(|bits| f64::from(bits as i32))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_access::Names;

    fn evaluate(text: &str) -> Result<bool, String> {
        let names = Names::default();
        let mut items: Vec<Item> = Vec::new();
        let mut find = |name: &str| {
            items.push(names.parse(if name == "Ready lamp" { "Q4.0" } else { name })?);
            Ok(items.len() - 1)
        };
        let expression = Expression::parse(text, &mut find)?;
        // Each signal has its byte address as its value; bits are 1.
        let bits = |at: usize| {
            let item = items.get(at)?;
            Some(if item.width == ob1_model::Width::Bit { 1 } else { item.cell.byte() })
        };
        Ok(expression.holds(&items, &bits))
    }

    #[test]
    fn conditions() {
        for (text, holds) in [
            ("M1.0", true),
            ("not M1.0", false),
            ("MW10 > 9", true),
            ("MW10>10", false),
            ("MW10 >= 10 and MW20 <> 20", false),
            ("MW10 = 16#A", true),
            ("MW10 == MB10", true),
            ("(MW10 < 5 or M1.0) and not (MW20 = 0)", true),
            ("MW10 < 5 or M1.0 and MW20 = 0", false),
            ("\"Ready lamp\" AND true", true),
            ("MD4 < 4.5", true),
            ("MD4 > -1", true),
            ("MD4 < T#5S", true),
        ] {
            assert_eq!(evaluate(text), Ok(holds), "{text}");
        }
        for wrong in ["", "MW10 >", "(M1.0", "M1.0 M2.0", "and", "\"open", "M1.0)", "MW10 ! 5", "Foo > 1"] {
            assert!(evaluate(wrong).is_err(), "{wrong}");
        }
        assert!(evaluate(&"(".repeat(100_000)).is_err() && evaluate(&"not ".repeat(100_000)).is_err());
    }

    #[test]
    fn what_is_not_there_does_not_hold() {
        let items = [Names::default().parse("DB9.DBX0.0").expect("a bit")];
        for text in ["DB9.DBX0.0", "not DB9.DBX0.0", "DB9.DBX0.0 = 0"] {
            let expression = Expression::parse(text, &mut |_| Ok(0)).expect("a condition");
            assert!(!expression.holds(&items, &|_| None), "{text}");
        }
    }
}
