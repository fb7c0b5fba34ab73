#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| ob1_tests::fuzz::scl::run(data));
