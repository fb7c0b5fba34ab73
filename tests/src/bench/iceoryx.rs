//! iceoryx2 beside the back plane, on the same cores in the same run: its publish-subscribe while both ends spin, and
//! its event while the receiver sleeps.

use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{NodeBuilder, ServiceName, ipc};

use super::peer::Failure;

/// What a CP has in one direction.
type Registers = [u64; 2];

/// The name of a service of this measurement: the process of the bench is in it.
fn name(process: &str, what: &str) -> Result<ServiceName, Failure> {
    Ok(format!("ob1/bench/{process}/{what}").as_str().try_into()?)
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
    let ends = Events::new(&process.to_string_lossy(), "back", "there")?;
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
