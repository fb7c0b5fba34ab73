#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| ob1_tests::fuzz::trace::run(data));
