//! The C ABI: programs in C, C++, Python and .NET on the library of this build, and what is shipped beside it.

mod behaviour;
mod cpp_examples;
mod cpp_guide;
mod dist_config;
mod dotnet;
mod headers;
mod python_examples;
mod set_user_id;
mod symbols;
mod vanish;
