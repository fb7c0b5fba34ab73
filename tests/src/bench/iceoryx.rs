//! iceoryx2 beside the back plane, on the same cores in the same run: its publish-subscribe while both ends spin, and
//! its event while the receiver sleeps.

use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{NodeBuilder, ServiceName, ipc};

use ob1_backplane::{CpuSide, Segment};

use super::backplane::{ROUND_TRIPS, ROUNDS, asleep, round_trip, timed};
use super::peer::{Failure, Peer};
use super::{Figure, in_turns, median};

/// What a CP has in one direction.
type Registers = [u64; 2];

/// The name of a service of this measurement: the process of the bench is in it.
fn name(process: &str, what: &str) -> Result<ServiceName, Failure> {
    Ok(format!("ob1/bench/{process}/{what}").as_str().try_into()?)
}

/// The back plane beside iceoryx2: a round trip of ours against one way of its publish-subscribe, half of its round
/// trip, while both spin; and its event there and back, while both sleep.
///
/// # Errors
/// If a segment or a process cannot be created.
pub fn measure() -> Result<[Figure; 2], Failure> {
    let registers = Segment::create_shared()?;
    let mut cpu = CpuSide::create(&registers, 16)?;
    let mut serial = 0u64;
    let mut through_registers = || round_trip(&mut cpu, &mut serial);
    let process = std::process::id().to_string();
    let ends = Registered::new(&process, "there", "back")?;
    let (ours, theirs) = in_turns(
        ROUNDS,
        || timed(&registers, "registers", &mut through_registers),
        || {
            let _peer = Peer::start_by_name("iceoryx", &process)?;
            ends.send([0; 2])?;
            ends.receive()?;
            let start = Instant::now();
            for round in 0..ROUND_TRIPS {
                ends.send([round; 2])?;
                ends.receive()?;
            }
            Ok(start.elapsed().as_nanos() as f64 / ROUND_TRIPS as f64 / 2.0)
        },
    )?;
    let events = Events::new(&process, "event-there", "event-back")?;
    let _other = Peer::start_by_name("iceoryx-event", &process)?;
    let mut of_events = Vec::new();
    for _ in 0..ROUNDS {
        of_events.push(asleep(|| {
            events.notify()?;
            events.wait()
        })?);
    }
    let spinning = Figure {
        what: "back plane round trip, 16 bytes, both spin".into(),
        value: ours,
        unit: "ns",
        floor: Some(("iceoryx2 publish-subscribe, one way", theirs)),
        aim: ("<= 1.0 x floor", ours <= theirs),
    };
    let asleep = Figure {
        what: "iceoryx2 event there and back, both asleep".into(),
        value: median(&mut of_events),
        unit: "ns",
        floor: None,
        aim: ("", true),
    };
    Ok([spinning, asleep])
}

/// One end of two services, one each way.
#[derive(Debug)]
pub struct Registered {
    there: Publisher<ipc::Service, Registers, ()>,
    back: Subscriber<ipc::Service, Registers, ()>,
}

impl Registered {
    /// Publishes on one service and subscribes to the other.
    ///
    /// # Errors
    /// What iceoryx2 refuses.
    pub fn new(process: &str, there: &str, back: &str) -> Result<Self, Failure> {
        let node = NodeBuilder::new().create::<ipc::Service>()?;
        let there = node.service_builder(&name(process, there)?).publish_subscribe::<Registers>().open_or_create()?;
        let back = node.service_builder(&name(process, back)?).publish_subscribe::<Registers>().open_or_create()?;
        Ok(Self { there: there.publisher_builder().create()?, back: back.subscriber_builder().create()? })
    }

    /// Sends.
    ///
    /// # Errors
    /// What iceoryx2 refuses.
    pub fn send(&self, registers: Registers) -> Result<(), Failure> {
        self.there.loan_uninit()?.write_payload(registers).send()?;
        Ok(())
    }

    /// Spins until something comes.
    ///
    /// # Errors
    /// What iceoryx2 refuses.
    pub fn receive(&self) -> Result<Registers, Failure> {
        loop {
            if let Some(sample) = self.back.receive()? {
                return Ok(*sample);
            }
            std::hint::spin_loop();
        }
    }
}

/// The peer of publish-subscribe: sends back what it receives. The path is the process of the bench.
///
/// # Errors
/// What iceoryx2 refuses.
pub fn answer_registers(process: &Path) -> Result<(), Failure> {
    let ends = Registered::new(&process.to_string_lossy(), "back", "there")?;
    tell()?;
    loop {
        ends.send(ends.receive()?)?;
    }
}

/// The peer of an event: sleeps until one comes, and answers with another.
///
/// # Errors
/// What iceoryx2 refuses.
pub fn answer_event(process: &Path) -> Result<(), Failure> {
    let ends = Events::new(&process.to_string_lossy(), "event-back", "event-there")?;
    tell()?;
    loop {
        ends.wait()?;
        ends.notify()?;
    }
}

/// Says on standard output that it is there.
fn tell() -> Result<(), Failure> {
    let mut out = std::io::stdout();
    out.write_all(b"!")?;
    out.flush()?;
    Ok(())
}

/// One end of two events, one each way.
#[derive(Debug)]
pub struct Events {
    there: iceoryx2::port::notifier::Notifier<ipc::Service>,
    back: iceoryx2::port::listener::Listener<ipc::Service>,
}

impl Events {
    /// Notifies one and listens to the other.
    ///
    /// # Errors
    /// What iceoryx2 refuses.
    pub fn new(process: &str, there: &str, back: &str) -> Result<Self, Failure> {
        let node = NodeBuilder::new().create::<ipc::Service>()?;
        let there = node.service_builder(&name(process, there)?).event().open_or_create()?;
        let back = node.service_builder(&name(process, back)?).event().open_or_create()?;
        Ok(Self { there: there.notifier_builder().create()?, back: back.listener_builder().create()? })
    }

    /// Rings.
    ///
    /// # Errors
    /// What iceoryx2 refuses.
    pub fn notify(&self) -> Result<(), Failure> {
        self.there.notify()?;
        Ok(())
    }

    /// Sleeps until it is rung.
    ///
    /// # Errors
    /// What iceoryx2 refuses.
    pub fn wait(&self) -> Result<(), Failure> {
        let mut rung = false;
        while !rung {
            self.back.timed_wait(|_| rung = true, Duration::from_secs(10))?;
        }
        Ok(())
    }
}
