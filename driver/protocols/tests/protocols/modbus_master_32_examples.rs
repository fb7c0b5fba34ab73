//! The loadable driver's chapter 5: source area, request, reply, destination area of every function, to the byte; and
//! every length and number at its limits. [S4 "5 Function Codes"]

#[allow(dead_code)] // The tables of the other tests.
use ob1_protocols::modbus_master_32::Parameters;
use ob1_protocols::modbus_master_32::job::{Function, Job};
use ob1_protocols::modbus_master_32::reply::evaluate;

use crate::modbus_master_32_table;
use crate::modbus_master_32_table::{bytes, check, hex};

/// 32-bit mode.
fn long() -> Parameters {
    Parameters { long_registers: true, ..Parameters::default() }
}

/// Source area | request | reply | destination area; the function's tables and examples, in the manual's order.
const EXAMPLES: &str = "
    05 01 0040 000F              | 05 01 0040 000F             | 05 01 02 01 F7         | 7701             # [S4 L855-L894]
    05 02 0120 0018              | 05 02 0120 0018             | 05 02 03 04 26 C8      | 2604 00C8        # [S4 L914-L946]
    05 03 0040 0002              | 05 03 0040 0002             | 05 03 04 2123 2527     | 2123 2527        # [S4 L962-L1001]
    05 43 0040 0002              | 05 03 0040 0002             | 05 03 08 21222324 25262728 | 21222324 25262728 # [S4 L1011-L1046]
    05 04 0050 0003              | 05 04 0050 0003             | 05 04 06 3132 3334 3536 | 3132 3334 3536  # [S4 L1055-L1097]; its byte counter 04H is a misprint
    05 05 0019 FF00              | 05 05 0019 FF00             | 05 05 0019 FF00        |                  # [S4 L1111-L1140]
    05 06 0180 3E7F              | 05 06 0180 3E7F             | 05 06 0180 3E7F        |                  # [S4 L1152-L1183]
    05 46 0180 11223344          | 05 06 0180 11223344         | 05 06 0180 11223344    |                  # [S4 L1199-L1234]
    05 07                        | 05 07                       | 05 07 3E               | 3E               # [S4 L1248-L1274]
    05 08 0000 A5C3              | 05 08 0000 A5C3             | 05 08 0000 A5C3        |                  # [S4 L1294-L1326]
    05 0B                        | 05 0B                       | 05 0B FEDC 0108        | FEDC 0108        # [S4 L1334-L1362]
    05 0C                        | 05 0C                       | 05 0C 46 8765 0108 0220 01 12 60*AA C2 D2 | 8765 0108 0220 01 12 60*AA C2 D2 # [S4 L1378-L1418]
    05 0F 0050 000A EFCD         | 05 0F 0050 000A 02 CD EF    | 05 0F 0050 000A        |                  # [S4 L1429-L1464]
    05 10 0060 0003 41A1 42A2 43A3 | 05 10 0060 0003 06 41A1 42A2 43A3 | 05 10 0060 0003  |                # [S4 L1476-L1515]
    05 50 0120 0002 51A152A2 53A354A4 | 05 10 0120 0002 08 51A152A2 53A354A4 | 05 10 0120 0002 |            # [S4 L1527-L1567]
";

fn columns(line: &str) -> Option<[&str; 4]> {
    let line = line.split('#').next().unwrap_or("").trim();
    let columns: Vec<&str> = line.split('|').map(str::trim).collect();
    (!line.is_empty()).then(|| columns.try_into().expect("four columns"))
}

#[test]
fn the_examples_of_chapter_5() {
    let mut functions = Vec::new();
    for [source, request, reply, destination] in EXAMPLES.lines().filter_map(columns) {
        let job = Job::of(b'X', &bytes(source), true).expect(source);
        assert_eq!(hex(job.request()), hex(&bytes(request)), "{source}");
        let area = evaluate(&job, &bytes(reply)).expect(source);
        assert_eq!(hex(area.bytes()), hex(&bytes(destination)), "{source}");
        functions.push(job.function());
        // And through the whole machine. LEN 32, as in the program of chapter 8, does not change the request. [S4
        // L2015]
        let padding = 32_usize.saturating_sub(bytes(source).len());
        let end = if destination.is_empty() {
            format!("30 say {reply} => ok")
        } else {
            format!("30 say {reply} => got {destination}\n 31 taken => ok")
        };
        let long_source = format!("{source} {padding}*EE");
        check(long(), &format!("0 start\n 1 job {long_source} => ask {request}\n 20 done\n {end}"));
        check(long(), &format!("0 start\n 1 job {source} => ask {request}\n 20 done\n {end}"));
    }
    assert!(Function::ALL.iter().all(|function| functions.contains(function)), "a function without its example");
}

/// The example of the loop back test on the line, character by character; its LRC, which the manual omits, is 8Bh. [S4
/// L696-L723]
#[test]
fn the_telegram_example_of_chapter_4() {
    assert_eq!(modbus_master_32_table::frame(&bytes("05 08 0000 A5C3")), ":05080000A5C38B\r\n");
}

/// Source area => request, or the number of the refusal.
const SOURCES: &str = "
    05                          => 0E40   # [S4 L1792]
    05 01 0000 00               => 0E41   # [S4 L1605], [S4 L1793]
    05 06 0000 00               => 0E41
    05 46 0000 1122 33          => 0E41   # [S4 L1611]
    05 46 0000 1122 3344        => 05 06 0000 11223344
    05 07 FF                    => 05 07  # [S4 L1612]
    05 08 0000 A5               => 0E41
    05 0F 0000 00               => 0E41
    05 00 0000 0001             => 0E42   # [S4 L1794]
    05 09                       => 0E42
    05 0A                       => 0E42
    05 0D                       => 0E42
    05 0E                       => 0E42
    05 11                       => 0E42
    05 17 0000 0001             => 0E42
    05 83 0000 0001             => 0E42
    FF 03 0000 0001             => FF 03 0000 0001   # the slave address is 1 to 255 [S4 L640]
    00 05 0001 FF00             => 00 05 0001 FF00   # [S4 L642]
    00 06 0001 1234             => 00 06 0001 1234
    00 0F 0001 0001 0001        => 00 0F 0001 0001 01 01
    00 10 0001 0001 1234        => 00 10 0001 0001 02 1234
    00 46 0001 11223344         => 00 06 0001 11223344
    00 01 0000 0001             => 0E43   # [S4 L1795]
    00 02 0000 0001             => 0E43
    00 03 0000 0001             => 0E43
    00 43 0000 0001             => 0E43
    00 04 0000 0001             => 0E43
    00 07                       => 0E43
    00 08 0000 0000             => 0E43
    00 0B                       => 0E43
    00 0C                       => 0E43
    05 01 FFFF 0000             => 0E44   # [S4 L852]
    05 01 FFFF 0001             => 05 01 FFFF 0001   # the start address is not checked [S4 L851]
    05 01 FFFF 07D8             => 05 01 FFFF 07D8
    05 01 FFFF 07D9             => 0E44
    05 02 FFFF 0000             => 0E44   # [S4 L908]
    05 02 FFFF 07D8             => 05 02 FFFF 07D8
    05 02 FFFF 07D9             => 0E44
    05 02 FFFF FFFF             => 0E44
    05 03 FFFF 0000             => 0E45   # [S4 L958], [S4 L1797]
    05 03 FFFF 007D             => 05 03 FFFF 007D
    05 03 FFFF 007E             => 0E45
    05 43 FFFF 0000             => 0E45   # [S4 L1007]
    05 43 FFFF 003E             => 05 03 FFFF 003E
    05 43 FFFF 003F             => 0E45
    05 04 FFFF 0000             => 0E45   # [S4 L1052]
    05 04 FFFF 007D             => 05 04 FFFF 007D
    05 04 FFFF 007E             => 0E45
    05 0F FFFF 0000 0000        => 0E46   # [S4 L1424], [S4 L1798]
    05 0F FFFF 07B9 248*FF      => 0E46
    05 0F 0001 07B8 248*FF      => 05 0F 0001 07B8 F7 247*FF
    05 10 FFFF 0000 0000        => 0E46   # [S4 L1473]
    05 10 FFFF 007C 248*FF      => 0E46
    05 10 0001 007B 246*FF      => 05 10 0001 007B F6 246*FF
    05 50 FFFF 0000 00000000    => 0E46   # [S4 L1524]
    05 50 FFFF 003E 248*FF      => 0E46
    05 50 0001 003D 244*FF      => 05 10 0001 003D F4 244*FF
    05 0F 0001 0001             => 0E47   # [S4 L1616], [S4 L1799]
    05 0F 0001 0001 00          => 0E47
    05 0F 0001 0008 1234        => 05 0F 0001 0008 01 34
    05 0F 0001 0009 1234        => 05 0F 0001 0009 02 34 12
    05 0F 0001 0011 1234        => 0E47
    05 0F 0001 0011 1234 5678   => 05 0F 0001 0011 03 34 12 78
    05 10 0001 0002 1234 56     => 0E47   # [S4 L1617]
    05 50 0001 0001 1234 56     => 0E47   # [S4 L1618]
    05 50 0001 0001 1234 5678   => 05 10 0001 0001 04 12345678
    05 05 0001 0000             => 05 05 0001 0000   # [S4 L1106-L1107]
    05 05 0001 00FF             => 0E48   # [S4 L1800]
    05 05 0001 FF01             => 0E48
    05 05 0001 0001             => 0E48
    05 08 0001 0000             => 0E49   # [S4 L1284], [S4 L1801]
    05 08 0100 0000             => 0E49
    05 41 0000 0001             => 0E4A   # [S4 L1802]
    05 42 0000 0001             => 0E4A
    05 44 0000 0001             => 0E4A
    05 45 0000 FF00             => 0E4A
    05 47                       => 0E4A
    05 48 0000 0000             => 0E4A
    05 4B                       => 0E4A
    05 4C                       => 0E4A
    05 4F 0000 0001 0001        => 0E4A
    05 40                       => 0E4A
    05 C3 0000 0001             => 0E4A
";

#[test]
fn every_source_area_at_its_limits() {
    for line in SOURCES.lines().map(|line| line.split('#').next().unwrap_or("").trim()).filter(|line| !line.is_empty())
    {
        let (source, wanted) = line.split_once("=>").expect("=>");
        let got = match Job::of(b'X', &bytes(source), true) {
            Ok(job) => hex(job.request()),
            Err(number) => format!("{number:04X}"),
        };
        assert_eq!(got, hex(&bytes(wanted)), "{line}");
    }
}

/// Without the parameter "32-bit mode" bit 6 is a part of the function code (ours). [S4 L838]
#[test]
fn without_32_bit_mode_the_bit_is_no_function_code() {
    for source in ["05 43 0000 0001", "05 46 0000 11223344", "05 50 0000 0001 11223344", "05 41 0000 0001"] {
        assert_eq!(Job::of(b'X', &bytes(source), false), Err(0x0E42), "{source}");
    }
    assert!(Job::of(b'X', &bytes("05 03 0000 0001"), false).is_ok_and(|job| !job.is_long()));
}

/// [S4 L1742], [S4 L1803], [S4 L2030]
#[test]
fn length_and_area_type_of_the_job() {
    let source = bytes("05 07");
    assert_eq!(Job::of(b'D', &source, true), Err(0x0E4F));
    assert_eq!(Job::of(0, &source, true), Err(0x0E4F));
    assert_eq!(Job::of(b'X', &source, true), Job::of(b'x', &source, true));
    assert_eq!(Job::of(b'X', &[], true), Err(0x0518));
    assert_eq!(Job::of(b'X', &bytes("05 07 4095*00"), true), Err(0x0518));
    assert!(Job::of(b'X', &bytes("05 07 4094*00"), true).is_ok());
}

/// Source area | reply => destination area (`-`: nothing is entered), or the number with which the job ends.
const REPLIES: &str = "
    05 03 0000 0001 | 06 03 02 1234          => 0E50   # [S4 L1807]
    05 03 0000 0001 | 05 04 02 1234          => 0E51   # [S4 L1808]
    05 03 0000 0001 | 05 84 02               => 0E51
    05 03 0000 0001 | 05                     => 0E52
    05 03 0000 0001 | 05 03                  => 0E52
    05 01 0000 0008 | 05 01 02 FF            => 0E52   # fewer than the byte counter says [S4 L1809]
    05 01 0000 0008 | 05 01 01 FF FF         => 0E53   # more [S4 L1810]
    05 01 0000 0009 | 05 01 01 FF            => 0E54   # [S4 L1811]
    05 01 0000 0008 | 05 01 02 FF FF         => 0E55   # [S4 L1812]
    05 02 0000 0010 | 05 02 01 FF            => 0E54
    05 02 0000 0010 | 05 02 03 FF FF FF      => 0E55
    05 04 0000 0002 | 05 04 02 1234          => 0E54
    05 04 0000 0002 | 05 04 06 1234 5678 9ABC => 0E55
    05 43 0000 0002 | 05 03 04 1234 5678     => 0E52   # the slave has registers of 16 bits there [S4 L844]
    05 03 0000 0002 | 05 03 08 11223344 55667788 => 0E53   # the slave has registers of 32 bits there [S4 L844]
    05 43 0000 0002 | 05 03 06 1234 5678 9ABC => 0E54
    05 43 0000 0002 | 05 03 0A 5*1234        => 0E55
    05 03 0000 0002 | 05 03 03 123456        => 0E54
    05 03 0000 0002 | 05 03 06 3*1234        => 0E55
    05 03 0000 0002 | 05 03 08 1234 5678     => 0E52
    05 07           | 05 07                  => 0E52
    05 07           | 05 07 3E 00            => 0E53
    05 0B           | 05 0B FEDC 01          => 0E52
    05 0B           | 05 0B FEDC 0108 00     => 0E53
    05 0C           | 05 0C                  => 0E52
    05 0C           | 05 0C 46 6*00          => 0E52
    05 0C           | 05 0C 06 7*00          => 0E53
    05 0C           | 05 0C 05 5*00          => 0E54
    05 0C           | 05 0C 47 71*00         => 0E55
    05 0C           | 05 0C 06 8765 0108 0220 => 8765 0108 0220   # no events yet (ours)
    05 05 0019 FF00 | 05 05 0019 0000        => 0E56   # [S4 L1813]
    05 05 0019 FF00 | 05 05 0019 FF          => 0E52
    05 05 0019 FF00 | 05 05 0019 FF00 00     => 0E53
    05 06 0019 1234 | 05 06 0018 1234        => 0E56
    05 46 0019 11223344 | 05 06 0019 1122    => 0E52
    05 46 0019 11223344 | 05 06 0019 11223345 => 0E56
    05 08 0000 A5C3 | 05 08 0000 A5C2        => 0E56
    05 0F 0001 0008 0001 | 05 0F 0001 0007   => 0E56
    05 10 0001 0001 1234 | 05 10 0002 0001   => 0E56
    05 10 0001 0001 1234 | 05 10 0001 0001 02 1234 => 0E53
    05 05 0019 FF00 | 05 85 01               => 0E61   # [S4 L1819-L1825]
    05 05 0019 FF00 | 05 85 02               => 0E62   # the manual's example [S4 L751-L754]
    05 03 0000 0001 | 05 83 03               => 0E63
    05 43 0000 0001 | 05 83 04               => 0E64
    05 0C           | 05 8C 05               => 0E65
    05 07           | 05 87 06               => 0E66
    05 10 0001 0001 1234 | 05 90 07          => 0E67
    05 03 0000 0001 | 05 83 00               => 0E51   # no such code (ours)
    05 03 0000 0001 | 05 83 08               => 0E51
    05 03 0000 0001 | 05 83                  => 0E52
    05 03 0000 0001 | 05 83 02 00            => 0E53
    05 01 0000 0001 | 05 01 01 FF            => 0001   # masked, and 00h as the high byte [S4 L898]
    05 01 0000 0008 | 05 01 01 FF            => 00FF
    05 02 0000 0011 | 05 02 03 A1 B2 C3      => B2A1 0001
    05 01 0000 001F | 05 01 04 01 02 03 FF   => 0201 7F03
    05 01 0000 07D8 | 05 01 FB 251*A5        => 250*A5 00A5
";

#[test]
fn every_reply_against_its_request() {
    for line in REPLIES.lines().map(|line| line.split('#').next().unwrap_or("").trim()).filter(|line| !line.is_empty())
    {
        let (left, wanted) = line.split_once("=>").expect("=>");
        let (source, reply) = left.split_once('|').expect("|");
        let job = Job::of(b'X', &bytes(source), true).expect(line);
        let got = match evaluate(&job, &bytes(reply)) {
            Ok(area) => hex(area.bytes()),
            Err(number) => format!("{number:04X}"),
        };
        assert_eq!(got, hex(&bytes(wanted)), "{line}");
    }
}
