use crate::tests::Fake;

/// In automatic mode, CYCLE 1 s, GAIN 2, no integral and no derivative action, set point 10.
fn fake() -> Fake {
    let fake = Fake::new("PID:FB58").with("MAN_ON", [0]).with("CYCLE", 1f32.to_be_bytes());
    fake.with("TI", [0; 4]).with("TD", [0; 4]).with("SP_INT", 10f32.to_be_bytes())
}

fn set(fake: &mut Fake, name: &str, value: f32) {
    fake.set(name, &value.to_be_bytes());
}

#[test]
fn the_instance_is_laid_out_as_in_step_7() {
    let fake = Fake::new("PID:FB58");
    for (name, at) in [
        ("INT_HNEG", "10.1"),
        ("SELECT", "12.0"),
        ("LMN_PER", "22.0"),
        ("QC_ACT", "24.3"),
        ("CYCLE", "26.0"),
        ("MAN_ON", "42.1"),
        ("DEADB_W", "44.0"),
        ("PER_MODE", "88.0"),
        ("TUN_KEEP", "90.3"),
        ("PHASE", "108.0"),
        ("QTUN_RUN", "114.0"),
        ("PI_CON", "116.0"),
        ("PID_CON", "124.0"),
        ("PAR_SAVE", "136.0"),
        ("PFAC_SP", "162.0"),
        ("CON_ZONE", "182.0"),
        ("PID_ON", "186.6"),
        ("GAIN_P", "188.0"),
        ("FIL_CYC", "248.0"),
        ("POI_CYCL", "252.0"),
    ] {
        assert_eq!(fake.at(name), at, "{name}");
    }
    assert_eq!((fake.real("GAIN"), fake.real("CYCLE_P"), fake.value("MAN_ON")), (2.0, 0.02, 1));
    assert_eq!(&fake.bytes("PAR_SAVE")[8..12], &40f32.to_be_bytes());
}

#[test]
fn proportional_with_limits_and_scaling() {
    for (pv, lmn, high, low) in [(0.0f32, 20.0f32, 0, 0), (-50.0, 100.0, 1, 0), (20.0, 0.0, 0, 1)] {
        let mut fake = fake().with("PV_IN", pv.to_be_bytes());
        fake.run();
        assert_eq!((fake.real("LMN"), fake.value("QLMN_HLM"), fake.value("QLMN_LLM")), (lmn, high, low), "{pv}");
        assert_eq!(fake.value("LMN_PER") as i16, (lmn * 276.48).round_ties_even() as i16);
        assert_eq!(fake.real("MAN"), lmn, "in automatic mode MAN follows");
    }
    let mut fake = fake().with("PVPER_ON", [1]).with("PV_PER", 50i16.to_be_bytes()).with("DISV", 3f32.to_be_bytes());
    fake = fake.with("LMN_FAC", 2f32.to_be_bytes()).with("LMN_OFFS", 1f32.to_be_bytes());
    fake.run();
    // 50 tenths of a degree: an error of 5, 10 % and 3 % of the disturbance, times 2, plus 1.
    assert_eq!((fake.real("PV"), fake.real("ER"), fake.real("LMN")), (5.0, 5.0, 27.0));
}

#[test]
fn integral_and_derivative() {
    let mut fake = fake().with("TI", 20f32.to_be_bytes());
    for i in [0.5f32, 1.5, 2.5] {
        fake.run();
        assert_eq!((fake.real("LMN_P"), fake.real("LMN_I"), fake.real("LMN")), (20.0, i, 20.0 + i));
    }
    fake.set("INT_HPOS", &[1]);
    fake.run();
    assert_eq!(fake.real("LMN_I"), 2.5, "held upwards");
    set(&mut fake, "PV_IN", 30.0);
    fake.run();
    assert!(fake.real("LMN_I") < 2.5, "not downwards");
    fake.set("I_ITL_ON", &[1]);
    set(&mut fake, "I_ITLVAL", 33.0);
    fake.run();
    assert_eq!(fake.real("LMN_I"), 33.0);

    // TD 10 s, D_F 5: the lag is 2 s. 10 / 2.5 * 20 in the first second, then 0.6 times as much each second.
    let mut fake = self::fake().with("TD", 10f32.to_be_bytes()).with("LMN_HLM", 1000f32.to_be_bytes());
    for d in [80f32, 48.0, 28.8] {
        fake.run();
        assert!((fake.real("LMN_D") - d).abs() < 0.001, "{d}");
    }
}

#[test]
fn set_point_steps_are_weakened() {
    for (factor, lmn) in [(1.0f32, 40.0f32), (0.5, 30.0), (0.0, 20.0)] {
        let mut fake = fake().with("TI", 1e9f32.to_be_bytes()).with("PFAC_SP", factor.to_be_bytes());
        fake.run();
        set(&mut fake, "SP_INT", 20.0);
        fake.run();
        assert!((fake.real("LMN") - lmn).abs() < 0.001, "{factor}: {}", fake.real("LMN"));
    }
}

#[test]
fn by_hand_and_back_without_a_bump() {
    let mut fake = fake().with("TI", 1e9f32.to_be_bytes()).with("MAN_ON", [1]).with("MAN", 55f32.to_be_bytes());
    fake.run();
    assert_eq!((fake.real("LMN"), fake.real("LMN_I")), (55.0, 35.0));
    fake.set("MAN_ON", &[0]);
    fake.run();
    assert!((fake.real("LMN") - 55.0).abs() < 0.001);
}

#[test]
fn the_control_zone_has_a_hysteresis() {
    let mut fake = fake().with("CONZ_ON", [1]).with("CON_ZONE", 10f32.to_be_bytes()).with("GAIN", 1f32.to_be_bytes());
    for (pv, lmn) in
        [(-1.0f32, 100.0f32), (1.0, 100.0), (2.5, 7.5), (0.5, 9.5), (-0.5, 100.0), (20.5, 0.0), (18.5, 0.0)]
    {
        set(&mut fake, "PV_IN", pv);
        fake.run();
        assert_eq!(fake.real("LMN"), lmn, "{pv}");
    }
    // A controller that cools: too warm asks for the high limit.
    let mut fake = fake.with("GAIN", (-1f32).to_be_bytes()).with("PV_IN", 25f32.to_be_bytes());
    fake.run();
    assert_eq!(fake.real("LMN"), 100.0);
}

#[test]
fn pulses() {
    // Ten pulse calls a period and five a PID cycle; 30 % are three of ten.
    let pulsed = |lmn: f32| {
        let fake = fake().with("MAN_ON", [1]).with("MAN", lmn.to_be_bytes()).with("PULSE_ON", [1]);
        let fake = fake.with("CYCLE", 0.5f32.to_be_bytes()).with("CYCLE_P", 0.1f32.to_be_bytes());
        fake.with("PER_TM", 1f32.to_be_bytes()).with("P_B_TM", 0.2f32.to_be_bytes())
    };
    for (lmn, signs) in
        [(30.0, "+++.......+++"), (10.0, "............."), (95.0, "+++++++++++++"), (80.0, "++++++++..+++")]
    {
        assert_eq!(pulsed(lmn).signs(13, "QPULSE", "QLMN_HLM").replace('?', "+").replace('-', "."), signs, "{lmn}");
    }
    // QC_ACT announces the call with the PID algorithm.
    let mut fake = pulsed(30.0);
    let mut due = Vec::new();
    for _ in 0..7 {
        due.push(fake.value("QC_ACT"));
        fake.run();
    }
    assert_eq!(due, [1, 0, 0, 0, 0, 1, 0]);
    // In two places: 2 counts and asks, 1 works once for it with the mean of the pulse calls.
    let mut fake = pulsed(30.0).with("SELECT", 2i16.to_be_bytes()).with("QC_ACT", [0]);
    for i in 0..5 {
        assert_eq!(fake.value("QC_ACT"), 0);
        set(&mut fake, "PV_IN", i as f32);
        fake.run();
    }
    assert_eq!(fake.value("QC_ACT"), 1);
    fake.set("SELECT", &1i16.to_be_bytes());
    fake.run();
    assert_eq!((fake.value("QC_ACT"), fake.real("PV")), (0, 2.0));
    set(&mut fake, "PV_IN", 50.0);
    fake.run();
    assert_eq!(fake.real("PV"), 2.0, "nothing to do");
}

#[test]
fn parameters_are_saved_and_loaded() {
    let mut fake = fake().with("SAVE_PAR", [1]).with("GAIN", 3f32.to_be_bytes());
    fake.run();
    assert_eq!(fake.value("SAVE_PAR"), 0);
    set(&mut fake, "GAIN", 7.0);
    fake.set("UNDO_PAR", &[1]);
    fake.run();
    assert_eq!((fake.real("GAIN"), fake.value("UNDO_PAR")), (7.0, 0), "only by hand");
    fake.set("MAN_ON", &[1]);
    fake.set("UNDO_PAR", &[1]);
    fake.run();
    assert_eq!((fake.real("GAIN"), fake.real("TI"), fake.real("D_F")), (3.0, 0.0, 5.0));
    // Nothing tuned: LOAD_PID loads nothing.
    fake.set("LOAD_PID", &[1]);
    fake.run();
    assert_eq!((fake.real("GAIN"), fake.value("PID_ON"), fake.value("LOAD_PID")), (3.0, 0, 0));
    fake.set("PI_CON", &[4f32.to_be_bytes(), 9f32.to_be_bytes()].concat());
    fake.set("LOAD_PID", &[1]);
    fake.run();
    assert_eq!((fake.real("GAIN"), fake.real("TI"), fake.real("TD"), fake.real("CON_ZONE")), (4.0, 9.0, 0.0, 62.5));
}

/// A furnace: two lags of 40 s and 15 s, 4 degrees a percent.
struct Furnace {
    inner: f64,
    value: f64,
    per_percent: f64,
}

impl Furnace {
    fn run(&mut self, fake: &mut Fake, seconds: usize) {
        for _ in 0..seconds {
            fake.run();
            let drive = f64::from(fake.real("LMN")) * self.per_percent;
            for _ in 0..10 {
                self.inner += (drive - self.inner) / 150.0;
                self.value += (self.inner - self.value) / 400.0;
            }
            set(fake, "PV_IN", 20.0 + self.value as f32);
        }
    }
}

#[test]
fn tuning_finds_parameters_that_control() {
    for (per_percent, gain) in [(4.0, 1.0f32), (-4.0, -1.0)] {
        let mut furnace = Furnace { inner: 0.0, value: 0.0, per_percent };
        let mut fake = fake().with("PV_IN", 20f32.to_be_bytes()).with("SP_INT", 20f32.to_be_bytes());
        fake = fake.with("GAIN", gain.to_be_bytes()).with("TUN_ON", [1]).with("TUN_DLMN", 40f32.to_be_bytes());
        furnace.run(&mut fake, 10);
        assert_eq!((fake.value("PHASE"), fake.real("LMN")), (1, 0.0));
        fake.set("TUN_ST", &[1]);
        furnace.run(&mut fake, 5);
        assert_eq!((fake.value("PHASE"), fake.value("QTUN_RUN"), fake.real("LMN")), (2, 1, 40.0));
        let set_point = 20.0 + 30.0 * per_percent as f32;
        set(&mut fake, "SP_INT", set_point);
        furnace.run(&mut fake, 100);
        assert_eq!((fake.value("PHASE"), fake.value("QTUN_RUN"), fake.value("TUN_ON")), (0, 0, 0));
        assert_eq!(fake.value("STATUS_H"), 10_000);
        // The true figures of this furnace: order between 1 and 2, TU 5.4 s, TA 79 s, 4 degrees a percent.
        assert!((1.3..2.0).contains(&fake.real("N_PTN")), "{}", fake.real("N_PTN"));
        assert!((4.0..8.0).contains(&fake.real("TU")), "{}", fake.real("TU"));
        assert!((55.0..95.0).contains(&fake.real("TA")), "{}", fake.real("TA"));
        assert!((3.0..5.0).contains(&fake.real("GAIN_P")), "{}", fake.real("GAIN_P"));
        assert!(fake.real("GAIN") * gain > 0.0 && fake.value("MAN_ON") == 0);
        let mut most = 0f32;
        for _ in 0..600 {
            furnace.run(&mut fake, 1);
            most = most.max((fake.real("PV") - 20.0) / (set_point - 20.0));
        }
        assert!((fake.real("PV") - set_point).abs() < 1.0, "{} {set_point}", fake.real("PV"));
        assert!(most < 1.15, "{most}");
    }
}

#[test]
fn tuning_that_cannot_be() {
    let mut fake = fake().with("TUN_ON", [1]).with("TUN_ST", [1]).with("TUN_DLMN", 4f32.to_be_bytes());
    fake.run();
    fake.run();
    assert_eq!((fake.value("STATUS_H"), fake.value("PHASE"), fake.value("TUN_ON")), (30_002, 0, 0));
    // Taken back while it waits, and while it searches.
    for calls in [1, 4] {
        let mut fake = self::fake().with("TUN_ON", [1]);
        fake.run();
        fake.set("TUN_ST", &[1]);
        (0..calls).for_each(|_| fake.run());
        fake.set("TUN_ON", &[0]);
        fake.run();
        assert_eq!((fake.value("STATUS_H"), fake.value("PHASE"), fake.value("QTUN_RUN")), (0, 0, 0));
    }
}

#[test]
fn a_restart_clears() {
    let mut fake = fake().with("I_ITLVAL", 7f32.to_be_bytes()).with("COM_RST", [1]).with("TI", 20f32.to_be_bytes());
    fake.run();
    assert_eq!((fake.real("LMN"), fake.real("LMN_I"), fake.value("COM_RST")), (0.0, 7.0, 0));
    fake.run();
    assert_eq!(fake.real("LMN_I"), 7.5);
}
