//! The library of a unit of somebody else, called as a master calls it: the counterpart of [`crate::abi`], and with it all `unsafe` there is.

use std::ffi::{CString, c_char, c_int, c_void};
use std::path::Path;
use std::ptr::{null, null_mut};

use libloading::Symbol;

type Handle = *mut c_void;
type Text = *const c_char;

/// Which standard a unit follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    /// FMI 2.
    Two,
    /// FMI 3.
    Three,
}

/// What a unit of FMI 2 calls back.
#[repr(C)]
struct Callbacks {
    /// Its further arguments, after the message, are left where they are.
    log: unsafe extern "C" fn(Handle, Text, c_int, Text, Text),
    allocate: unsafe extern "C" fn(usize, usize) -> Handle,
    free: unsafe extern "C" fn(Handle),
    finished: Option<unsafe extern "C" fn(Handle, c_int)>,
    environment: Handle,
}

/// An instance of a unit with its library.
pub struct Library {
    version: Version,
    instance: Handle,
    library: libloading::Library,
    /// FMI 2 keeps the pointer.
    _callbacks: Box<Callbacks>,
}

unsafe extern "C" fn log_2(_: Handle, _: Text, status: c_int, _: Text, message: Text) {
    // SAFETY: the unit's text.
    unsafe { log(status, message) }
}

unsafe extern "C" fn log_3(_: Handle, status: c_int, _: Text, message: Text) {
    // SAFETY: the unit's text.
    unsafe { log(status, message) }
}

/// Says what a unit complains of.
unsafe fn log(status: c_int, message: Text) {
    if status > 0 && !message.is_null() {
        // SAFETY: by the standards texts end with a null.
        let words = unsafe { std::ffi::CStr::from_ptr(message) }.to_string_lossy();
        coupling::say!("controller: {words}");
    }
}

unsafe extern "C" fn allocate(n: usize, size: usize) -> Handle {
    // SAFETY: as C has it.
    unsafe { libc::calloc(n, size) }
}

unsafe extern "C" fn free(at: Handle) {
    // SAFETY: what `allocate` gave.
    unsafe { libc::free(at) }
}

/// Calls a function of the library by its name and type; the error says that there is none.
macro_rules! call {
    ($library:expr, $name:literal, fn($($kind:ty),* $(,)?) -> $result:ty, $($value:expr),* $(,)?) => {{
        // SAFETY: the function has this type by the standard.
        let found: Result<Symbol<unsafe extern "C" fn($($kind),*) -> $result>, _> = unsafe { $library.get($name) };
        let name = || String::from_utf8_lossy($name).into_owned();
        match found {
            // SAFETY: arguments are as the standard wants them.
            Ok(function) => Ok(unsafe { function($($value),*) }),
            Err(_) => Err(format!("its library has no function {}", name())),
        }
    }};
}

/// Refuses a status beyond a warning.
fn fine(name: &str, status: c_int) -> Result<(), String> {
    if status <= 1 { Ok(()) } else { Err(format!("{name} ends with status {status}")) }
}

impl Library {
    /// An instance of the unit in a library.
    pub fn instantiate(
        file: &Path,
        version: Version,
        token: &str,
        resources: &Path,
    ) -> Result<Library, String> {
        let text = |s: &str| CString::new(s).map_err(|_| format!("`{s}` has a null in it"));
        // SAFETY: a person names this unit to be run.
        let library = unsafe { libloading::Library::new(file) }.map_err(|e| e.to_string())?;
        let callbacks =
            Box::new(Callbacks { log: log_2, allocate, free, finished: None, environment: null_mut() });
        let (name, token) = (text("controller")?, text(token)?);
        let path = resources.to_string_lossy();
        let instance = match version {
            Version::Two => {
                let resources = text(&format!("file://{path}"))?;
                call!(
                    library,
                    b"fmi2Instantiate",
                    fn(Text, c_int, Text, Text, *const Callbacks, c_int, c_int) -> Handle,
                    name.as_ptr(),
                    1,
                    token.as_ptr(),
                    resources.as_ptr(),
                    &raw const *callbacks,
                    0,
                    0
                )?
            }
            Version::Three => {
                let resources = text(&format!("{path}{}", std::path::MAIN_SEPARATOR))?;
                call!(
                    library,
                    b"fmi3InstantiateCoSimulation",
                    fn(
                        Text,
                        Text,
                        Text,
                        u8,
                        u8,
                        u8,
                        u8,
                        *const u32,
                        usize,
                        Handle,
                        unsafe extern "C" fn(Handle, c_int, Text, Text),
                        *const c_void,
                    ) -> Handle,
                    name.as_ptr(),
                    token.as_ptr(),
                    resources.as_ptr(),
                    0,
                    0,
                    0,
                    0,
                    null(),
                    0,
                    null_mut(),
                    log_3,
                    null()
                )?
            }
        };
        match instance.is_null() {
            true => Err("it makes no instance".into()),
            false => Ok(Library { version, instance, library, _callbacks: callbacks }),
        }
    }

    /// Starts the simulation at a time \[s\].
    pub fn initialize(&mut self, start: f64) -> Result<(), String> {
        let (library, instance) = (&self.library, self.instance);
        match self.version {
            Version::Two => {
                let set = call!(
                    library,
                    b"fmi2SetupExperiment",
                    fn(Handle, c_int, f64, f64, c_int, f64) -> c_int,
                    instance,
                    0,
                    0.0,
                    start,
                    0,
                    0.0
                )?;
                fine("fmi2SetupExperiment", set)?;
                fine(
                    "fmi2EnterInitializationMode",
                    call!(library, b"fmi2EnterInitializationMode", fn(Handle) -> c_int, instance)?,
                )?;
                fine(
                    "fmi2ExitInitializationMode",
                    call!(library, b"fmi2ExitInitializationMode", fn(Handle) -> c_int, instance)?,
                )
            }
            Version::Three => {
                let entered = call!(
                    library,
                    b"fmi3EnterInitializationMode",
                    fn(Handle, u8, f64, f64, u8, f64) -> c_int,
                    instance,
                    0,
                    0.0,
                    start,
                    0,
                    0.0
                )?;
                fine("fmi3EnterInitializationMode", entered)?;
                fine(
                    "fmi3ExitInitializationMode",
                    call!(library, b"fmi3ExitInitializationMode", fn(Handle) -> c_int, instance)?,
                )
            }
        }
    }

    /// Goes on by a step \[s\].
    pub fn step(&mut self, from: f64, size: f64) -> Result<(), String> {
        let (library, instance) = (&self.library, self.instance);
        match self.version {
            Version::Two => {
                let done = call!(
                    library,
                    b"fmi2DoStep",
                    fn(Handle, f64, f64, c_int) -> c_int,
                    instance,
                    from,
                    size,
                    1
                )?;
                fine("fmi2DoStep", done)
            }
            Version::Three => {
                let (mut event, mut ends, mut early, mut last) = (0_u8, 0_u8, 0_u8, 0.0_f64);
                let done = call!(
                    library,
                    b"fmi3DoStep",
                    fn(Handle, f64, f64, u8, *mut u8, *mut u8, *mut u8, *mut f64) -> c_int,
                    instance,
                    from,
                    size,
                    1,
                    &raw mut event,
                    &raw mut ends,
                    &raw mut early,
                    &raw mut last
                )?;
                fine("fmi3DoStep", done)?;
                if ends != 0 { Err(format!("it ends the simulation at {last} s")) } else { Ok(()) }
            }
        }
    }

    /// Values of scalars.
    pub fn get(&mut self, references: &[u32]) -> Result<Vec<f64>, String> {
        let (library, instance, n) = (&self.library, self.instance, references.len());
        let mut values = vec![f64::NAN; n];
        let status = match self.version {
            Version::Two => call!(
                library,
                b"fmi2GetReal",
                fn(Handle, *const u32, usize, *mut f64) -> c_int,
                instance,
                references.as_ptr(),
                n,
                values.as_mut_ptr()
            )?,
            Version::Three => call!(
                library,
                b"fmi3GetFloat64",
                fn(Handle, *const u32, usize, *mut f64, usize) -> c_int,
                instance,
                references.as_ptr(),
                n,
                values.as_mut_ptr(),
                n
            )?,
        };
        fine("getting values", status)?;
        Ok(values)
    }
}

impl Drop for Library {
    fn drop(&mut self) {
        let (library, instance) = (&self.library, self.instance);
        let _ = match self.version {
            Version::Two => call!(library, b"fmi2FreeInstance", fn(Handle) -> (), instance),
            Version::Three => call!(library, b"fmi3FreeInstance", fn(Handle) -> (), instance),
        };
    }
}
