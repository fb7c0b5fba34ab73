//! Series, parallels, exclusive or, and what they are made of.

use ob1_ir::{BitTest, Logic, Op};

use super::{Mode, Parsed, Parser};
use crate::not_drawn::Reason;
use crate::tree::{Kind, Node};

impl Parser<'_> {
    /// Logic that begins a string.
    pub(super) fn logic(&mut self) -> Parsed<Node> {
        self.deeper(Self::string)
    }

    /// The input of a box.
    pub(super) fn argument(&mut self) -> Parsed<Node> {
        if self.at_branch(self.at) && self.mode == Mode::Step7 {
            return self.wrong("an input that begins at a branch");
        }
        let start = self.here();
        let logic = self.logic()?;
        self.as_argument(logic, start)
    }

    /// Logic as the input of a box, where STEP 7 brackets a lone parallel, compare or box.
    pub(super) fn as_argument(&self, logic: Node, start: u32) -> Parsed<Node> {
        let Node { id, statements, kind } = logic;
        match kind {
            Kind::Series { mut items, bare: false } if items.len() == 1 && !is_contact(items.first()) => {
                items.pop().map_or_else(|| self.wrong("no logic"), Ok)
            }
            kind @ (Kind::Contact { .. } | Kind::Series { .. }) => Ok(Node { id, statements, kind }),
            _ if self.mode == Mode::Step7 => Err(Reason { statement: start, what: "a parallel without brackets" }),
            kind => {
                let items = vec![Node { id, statements: statements.clone(), kind }];
                Ok(Node { id, statements, kind: Kind::Series { items, bare: true } })
            }
        }
    }

    /// Logic begins here, not a box.
    pub(super) fn logic_ahead(&self) -> bool {
        match self.op(0) {
            Some(Op::Scan { .. } | Op::Open { .. }) => true,
            Some(op) => op.loads() && self.compare_ahead(),
            None => false,
        }
    }

    pub(super) fn compare_ahead(&self) -> bool {
        self.op(0).is_some_and(Op::loads)
            && self.op(1).is_some_and(Op::loads)
            && matches!(self.op(2), Some(Op::Compare(..)))
    }

    fn string(&mut self) -> Parsed<Node> {
        let start = self.here();
        let first = match self.op(0) {
            Some(Op::Scan { logic: Logic::And, .. } | Op::Open { logic: Logic::And, .. }) => {
                let series = self.series(start, Vec::new(), false)?;
                if self.leg_ahead() { self.parallel(start, Some(series))? } else { return Ok(series) }
            }
            Some(Op::Scan { logic: Logic::Or, .. } | Op::Open { logic: Logic::Or, .. }) => {
                self.parallel(start, None)?
            }
            Some(Op::Scan { logic: Logic::Xor, .. } | Op::Open { logic: Logic::Xor, .. }) => self.exclusive(start)?,
            Some(op) if op.loads() && self.compare_ahead() => self.compare()?,
            _ => return self.wrong("no logic begins here"),
        };
        if !self.element_ahead() {
            return Ok(first);
        }
        if self.mode == Mode::Step7 {
            return self.wrong("a parallel without brackets");
        }
        self.series(start, vec![first], true)
    }

    /// Something that continues a series.
    fn element_ahead(&self) -> bool {
        match self.op(0) {
            Some(
                Op::Scan { logic: Logic::And, .. }
                | Op::Open { logic: Logic::And, .. }
                | Op::NotRlo
                | Op::EdgePositive(_)
                | Op::EdgeNegative(_)
                | Op::Build(100),
            ) => true,
            Some(Op::Assign(place)) => self.connects(*place),
            _ => false,
        }
    }

    /// `= b; U b`: a connector, not the end of the string; if the input of a call begins there, a coil.
    fn connects(&self, place: ob1_ir::Place) -> bool {
        let same = Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(place) };
        let goes_on = self.op(1) == Some(&same) && self.op(2) != Some(&Op::Build(102));
        goes_on && !self.network.is_hidden(&place) && (self.in_input || self.input_ahead(self.at + 1).is_none())
    }

    fn leg_ahead(&self) -> bool {
        matches!(self.op(0), Some(Op::OrBranch | Op::Scan { logic: Logic::Or, .. } | Op::Open { logic: Logic::Or, .. }))
    }

    /// Elements one behind the other; one alone is itself if it is a contact.
    fn series(&mut self, start: u32, mut items: Vec<Node>, bare: bool) -> Parsed<Node> {
        while self.element_ahead() {
            let item = self.element(items.is_empty())?;
            items.push(item);
        }
        match items.as_slice() {
            [] => self.wrong("no logic begins here"),
            [Node { kind: Kind::Contact { .. }, .. }] => items.pop().map_or_else(|| self.wrong("no logic"), Ok),
            _ => Ok(self.node(start, Kind::Series { items, bare })),
        }
    }

    fn element(&mut self, first: bool) -> Parsed<Node> {
        let start = self.here();
        self.direct(self.at)?;
        let Some(op) = self.op(0) else { return self.wrong("the network ends here") };
        if first && !matches!(op, Op::Scan { .. } | Op::Open { .. }) {
            return self.wrong("nothing stands before it");
        }
        let kind = match op {
            Op::Scan { negate, test, .. } => {
                self.at += 1;
                Kind::Contact { negate: *negate, test: *test }
            }
            Op::Open { negate, .. } => return self.bracket(*negate),
            Op::NotRlo => {
                self.at += 1;
                Kind::Not
            }
            Op::Build(_) => {
                self.at += 1;
                return match self.edge(start, true) {
                    Some(edge) => Ok(edge),
                    None => self.wrong("no edge behind BLD 100"),
                };
            }
            Op::EdgePositive(_) | Op::EdgeNegative(_) => {
                return self.edge(start, false).map_or_else(|| self.wrong("no edge"), Ok);
            }
            Op::Assign(place) => {
                self.at += 2;
                Kind::Connector(*place)
            }
            _ => return self.wrong("no element"),
        };
        Ok(self.node(start, kind))
    }

    fn edge(&mut self, start: u32, boxed: bool) -> Option<Node> {
        let (rising, memory) = match self.op(0)? {
            Op::EdgePositive(memory) => (true, *memory),
            Op::EdgeNegative(memory) => (false, *memory),
            _ => return None,
        };
        self.at += 1;
        Some(self.node(start, Kind::Edge { rising, memory, boxed }))
    }

    /// `U( .. )`, `O( .. )`, `X( .. )`: the logic between, negated or not.
    fn bracket(&mut self, negate: bool) -> Parsed<Node> {
        let start = self.here();
        self.at += 1;
        let inner = self.deeper(|parser| {
            let inside = parser.here();
            let logic = if parser.logic_ahead() { Some(parser.logic()?) } else { None };
            if let Some(logic) = logic.clone()
                && parser.eat(&Op::Close)
            {
                return Ok(logic);
            }
            let node = parser.boxed(logic, inside)?;
            if super::is_open(&node) {
                return parser.wrong("its output does not go on");
            }
            parser.expect(&Op::Close, "no `)`")?;
            Ok(node)
        })?;
        Ok(match (negate, &inner.kind) {
            (true, _) => self.node(start, Kind::Negated(Box::new(inner))),
            // One contact in brackets of its own.
            (false, Kind::Contact { .. }) => self.node(start, Kind::Series { items: vec![inner], bare: false }),
            (false, _) => Node { statements: self.since(start), ..inner },
        })
    }

    /// Legs; the first may have come already.
    fn parallel(&mut self, start: u32, first: Option<Node>) -> Parsed<Node> {
        let mut legs = Vec::new();
        if let Some(first) = first {
            if self.mode == Mode::Step7 && is_contact(Some(&first)) {
                return self.wrong("a first leg that begins with U");
            }
            legs.push(match first.kind {
                Kind::Contact { .. } => Node {
                    id: 0,
                    statements: first.statements.clone(),
                    kind: Kind::Series { items: vec![first], bare: false },
                },
                _ => first,
            });
        }
        while self.leg_ahead() {
            let leg = self.leg()?;
            legs.push(leg);
        }
        if legs.len() < 2 && self.mode == Mode::Step7 {
            return self.wrong("a parallel of one leg");
        }
        Ok(self.node(start, Kind::Parallel(legs)))
    }

    fn leg(&mut self) -> Parsed<Node> {
        let start = self.here();
        self.direct(self.at)?;
        match self.op(0) {
            Some(Op::Scan { negate, test, .. }) => {
                self.at += 1;
                Ok(self.node(start, Kind::Contact { negate: *negate, test: *test }))
            }
            Some(Op::Open { negate, .. }) => self.bracket(*negate),
            _ => {
                self.at += 1;
                let inside = self.here();
                let leg = self.series(inside, Vec::new(), false)?;
                Ok(match leg.kind {
                    Kind::Contact { .. } => {
                        if self.mode == Mode::Step7 {
                            return self.wrong("a leg of one contact behind `O`");
                        }
                        self.node(start, Kind::Series { items: vec![leg], bare: false })
                    }
                    _ => Node { statements: self.since(start), ..leg },
                })
            }
        }
    }

    fn exclusive(&mut self, start: u32) -> Parsed<Node> {
        let mut legs = Vec::new();
        loop {
            let begin = self.here();
            self.direct(self.at)?;
            match self.op(0) {
                Some(Op::Scan { logic: Logic::Xor, negate, test }) => {
                    self.at += 1;
                    legs.push(self.node(begin, Kind::Contact { negate: *negate, test: *test }));
                }
                Some(Op::Open { logic: Logic::Xor, negate }) => legs.push(self.bracket(*negate)?),
                _ => return Ok(self.node(start, Kind::Xor(legs))),
            }
        }
    }

    fn compare(&mut self) -> Parsed<Node> {
        let start = self.here();
        let values = [self.take()?, self.take()?];
        let Some(Op::Compare(format, how)) = self.op(0) else { return self.wrong("no comparison") };
        self.at += 1;
        Ok(self.node(start, Kind::Compare { values, format: *format, how: *how }))
    }
}

fn is_contact(node: Option<&Node>) -> bool {
    matches!(node.map(|node| &node.kind), Some(Kind::Contact { .. }))
}
