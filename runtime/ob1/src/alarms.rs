//! `ob1 alarms STATION`: what is active or not acknowledged, and its acknowledgement.

use clap::Args;
use ob1_access::alarms::StandingAlarm;
use ob1_model::alarm_number;
use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::protocol::Op;

use crate::exit::Exit;
use crate::remote::print_json;

/// List the alarms of a running station, or acknowledge them
///
/// Those that are active or not acknowledged, the most urgent first: state, time by the CPU's clock, message number,
/// text with its values. The texts are those of the table `alarms` in [program]. What the program has sent with
/// ALARM_SQ, ALARM_DQ, ALARM, ALARM_8 or ALARM_8P is to be acknowledged; whoever has done so, every display is told.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 alarms press.toml\n  ob1 alarms press ack 16#60000001\n  ob1 alarms press ack all\n\nExit codes: 0 done, \
    1 no such alarm, 5 the station does not run, 8 refused.\n\nMore: docs/alarms.md, docs/alarm-texts.md."
)]
pub struct AlarmsArgs {
    /// A running station: its name or its file
    station: String,
    /// What to do with them: ack
    #[arg(value_parser = ["ack"], requires = "which")]
    order: Option<String>,
    /// Message numbers, or all
    #[arg(value_name = "NUMBER|all")]
    which: Vec<String>,
    /// As JSON: an array of the alarms that are left
    #[arg(long)]
    json: bool,
}

/// Lists or acknowledges.
pub fn alarms(args: &AlarmsArgs) -> Result<Exit, AccessError> {
    let mut client = Client::to_station(&args.station)?;
    let standing = |client: &mut Client| -> Result<Vec<StandingAlarm>, AccessError> {
        Ok(client.ask(Op::Alarms { acknowledge: Vec::new() })?.alarms.unwrap_or_default())
    };
    if args.order.is_some() {
        let mut wanted = Vec::new();
        for which in &args.which {
            if which == "all" {
                let open = standing(&mut client)?.into_iter().filter(|alarm| !alarm.acknowledged);
                wanted.extend(open.map(|alarm| alarm.number));
            } else if let Some(number) = ob1_station_file::alarm_texts::number_of(which) {
                wanted.push(number);
            } else {
                err!(
                    "ob1: \"{which}\" is no message number\n  = write it as 1 to 4294967295 or 16#60000001, or write all"
                );
                return Ok(Exit::Usage);
            }
        }
        wanted.sort_unstable();
        wanted.dedup();
        let mut missing = Vec::new();
        for part in wanted.chunks(ob1_model::ALARM_ORDERS) {
            missing.extend(client.ask(Op::Alarms { acknowledge: part.to_vec() })?.missing.unwrap_or_default());
        }
        if !missing.is_empty() {
            let numbers: Vec<String> = missing.iter().map(|number| alarm_number(*number)).collect();
            err!("ob1: there is no alarm {}\n  = `ob1 alarms {}` lists them", numbers.join(", "), args.station);
            return Ok(Exit::Usage);
        }
        if !args.json {
            say!("{} acknowledged", wanted.len());
            return Ok(Exit::Ok);
        }
    }
    let alarms = standing(&mut client)?;
    if args.json {
        return Ok(print_json(&alarms));
    }
    if alarms.is_empty() {
        say!("no alarm is active or waits for its acknowledgement");
    }
    alarms.iter().for_each(|alarm| say!("{}", line(alarm)));
    Ok(Exit::Ok)
}

/// One alarm in a line.
fn line(alarm: &StandingAlarm) -> String {
    let state = match (alarm.active, alarm.acknowledged) {
        (true, false) => "active, open",
        (true, true) => "active",
        (false, _) => "gone, open",
    };
    let locked = if alarm.locked { " (locked)" } else { "" };
    let class = if alarm.class.is_empty() { String::new() } else { format!("  {}", alarm.class) };
    let went = if alarm.went.is_empty() { String::new() } else { format!(", until {}", alarm.went) };
    let info = if alarm.info.is_empty() { String::new() } else { format!("\n    {}", alarm.info) };
    format!(
        "{state:<12}  {}{went}  {}.{}{class}  {}{locked}{info}",
        alarm.came,
        alarm_number(alarm.number),
        alarm.signal,
        alarm.text
    )
}
