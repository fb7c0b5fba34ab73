//! The CPU: memory, process image, scan loop, diagnostic buffer, access port, reference engine
