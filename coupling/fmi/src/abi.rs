//! The functions of FMI 3.0 as C sees them. All `unsafe` of the units is here: arrays and texts of the master become slices and strings, and
//! its callbacks are called; everything else is in [`crate::instance`].
//!
//! Pointers to instances and states are [handles](crate::registry) and never followed. A null array with a count is an error, a panic is
//! caught and told as one, and no lock is held while the master is called back.

#![allow(clippy::missing_safety_doc)] // They are those of the standard: pointers are to as many values as the count beside them says.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use crate::error::UnitError;
use crate::instance::{Instance, Progress};
use crate::registry::Registry;
use crate::resources::load;
use crate::saved::SavedState;
use crate::variable::Kind;

type Handle = *mut c_void;
type Text = *const c_char;
type Status = c_int;
/// C's `bool`: any byte, so that none is invalid.
type Boolean = u8;
type Reference = u32;
type Log = Option<unsafe extern "C" fn(Handle, Status, Text, Text)>;
type Update =
    Option<unsafe extern "C" fn(Handle, f64, Boolean, Boolean, Boolean, Boolean, *mut Boolean, *mut f64)>;

const OK: Status = 0;
const DISCARD: Status = 2;
const ERROR: Status = 3;

/// An instance with what the master gave along.
struct Held {
    instance: Mutex<Instance>,
    master: Master,
    update: Update,
    /// Texts that were handed out; they stay until the next are.
    texts: Mutex<Vec<CString>>,
}

/// Whom to tell.
#[derive(Clone, Copy)]
struct Master {
    /// Its pointer, handed back as it is.
    environment: usize,
    log: Log,
}

static INSTANCES: LazyLock<Registry<Arc<Held>>> = LazyLock::new(Registry::default);
/// States, each with the handle of its instance.
static STATES: LazyLock<Registry<(usize, Arc<SavedState>)>> = LazyLock::new(Registry::default);

impl Master {
    fn tell(&self, status: Status, category: &str, words: &str) {
        let Some(log) = self.log else { return };
        let text = |s: &str| CString::new(s.replace('\0', " ")).unwrap_or_default();
        let (category, words) = (text(category), text(words));
        // SAFETY: the master's own function with its own pointer; both texts live until it returns.
        unsafe { log(self.environment as Handle, status, category.as_ptr(), words.as_ptr()) }
    }

    /// The status of a result; what went wrong is told.
    fn answer(&self, name: &str, result: Result<(), UnitError>) -> Status {
        let (status, category) = match &result {
            Ok(()) => return OK,
            Err(UnitError::Wrong(_)) => (ERROR, "logStatusError"),
            Err(UnitError::NoSolution(_)) => (DISCARD, "logStatusDiscard"),
        };
        let words = result.expect_err("matched").to_string();
        self.tell(status, category, &format!("{name}: {words}"));
        status
    }
}

impl Held {
    fn lock(&self) -> MutexGuard<'_, Instance> {
        self.instance.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a call comes to, with panics caught.
fn caught(call: impl FnOnce() -> Result<(), UnitError>) -> Result<(), UnitError> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<&str>().map(|s| s.to_string());
        let words = words.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        Err(UnitError::Wrong(format!("an error of the program: {words}")))
    })
}

/// Calls the instance of a handle.
fn with_held(handle: Handle, call: impl FnOnce(&Held) -> Result<(), UnitError>) -> Status {
    // Without an instance there is nobody to tell.
    let held = catch_unwind(|| INSTANCES.get(handle.addr())).ok().flatten();
    let Some(held) = held else { return ERROR };
    let result = caught(|| call(&held));
    if result.is_ok() {
        return OK;
    }
    let name = held.lock().name().to_string();
    held.master.answer(&name, result)
}

fn with(handle: Handle, call: impl FnOnce(&mut Instance) -> Result<(), UnitError>) -> Status {
    with_held(handle, |held| call(&mut held.lock()))
}

/// What no unit of ours has.
fn none(handle: Handle, call: &str) -> Status {
    with(handle, |instance| Err(instance.has_none(call)))
}

/// `n` values at a pointer.
unsafe fn slice<'a, T>(values: *const T, n: usize) -> Result<&'a [T], UnitError> {
    match n {
        0 => Ok(&[]),
        _ if values.is_null() || !values.is_aligned() => {
            Err(UnitError::Wrong(format!("a null array of {n} values")))
        }
        // SAFETY: by the standard the array has `n` values and does not change during the call.
        _ => Ok(unsafe { std::slice::from_raw_parts(values, n) }),
    }
}

/// Copies values to where the master wants them.
unsafe fn write<T: Copy>(to: *mut T, values: &[T]) -> Result<(), UnitError> {
    if values.is_empty() {
        return Ok(());
    }
    if to.is_null() || !to.is_aligned() {
        return Err(UnitError::Wrong(format!("a null array for {} values", values.len())));
    }
    // SAFETY: by the standard there is room for as many values, none of them ours.
    unsafe { std::ptr::copy_nonoverlapping(values.as_ptr(), to, values.len()) };
    Ok(())
}

/// A text of the master.
unsafe fn text(given: Text) -> Option<String> {
    // SAFETY: by the standard texts end with a null.
    (!given.is_null()).then(|| unsafe { CStr::from_ptr(given) }.to_string_lossy().into_owned())
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> Text {
    c"3.0".as_ptr()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    name: Text,
    token: Text,
    resources: Text,
    _visible: Boolean,
    logging: Boolean,
    event_mode: Boolean,
    early_return: Boolean,
    _intermediate: *const Reference,
    _n_intermediate: usize,
    environment: Handle,
    log: Log,
    update: Update,
) -> Handle {
    let master = Master { environment: environment.addr(), log };
    let mut handle = 0;
    // SAFETY: texts of the master.
    let [name, token, resources] = [name, token, resources].map(|t| unsafe { text(t) });
    let called = name.clone().unwrap_or_default();
    let made = caught(|| {
        let (Some(name), Some(token), Some(resources)) = (name, token, resources) else {
            return Err(UnitError::wrong(
                "instanceName, instantiationToken and resourcePath must all be given",
            ));
        };
        if event_mode != 0 {
            return Err(UnitError::wrong(
                "this unit has no event mode; instantiate it with eventModeUsed false",
            ));
        }
        let model = load(Path::new(&resources), &token)?;
        let instance = Instance::new(&name, &model, logging != 0, early_return != 0);
        let texts = Mutex::default();
        handle = INSTANCES.put(Arc::new(Held { instance: Mutex::new(instance), master, update, texts }));
        Ok(())
    });
    match master.answer(&called, made) {
        OK => std::ptr::without_provenance_mut(handle),
        _ => std::ptr::null_mut(),
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateModelExchange(
    name: Text,
    _token: Text,
    _resources: Text,
    _visible: Boolean,
    _logging: Boolean,
    environment: Handle,
    log: Log,
) -> Handle {
    // SAFETY: a text of the master.
    unsafe { refuse(name, environment, log, "model exchange") }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateScheduledExecution(
    name: Text,
    _token: Text,
    _resources: Text,
    _visible: Boolean,
    _logging: Boolean,
    environment: Handle,
    log: Log,
    _clock: Option<unsafe extern "C" fn(Handle)>,
    _lock: Option<unsafe extern "C" fn()>,
    _unlock: Option<unsafe extern "C" fn()>,
) -> Handle {
    // SAFETY: a text of the master.
    unsafe { refuse(name, environment, log, "scheduled execution") }
}

unsafe fn refuse(name: Text, environment: Handle, log: Log, kind: &str) -> Handle {
    let master = Master { environment: environment.addr(), log };
    // SAFETY: a text of the master.
    let name = unsafe { text(name) }.unwrap_or_default();
    let why = format!("this unit is one for co-simulation, not for {kind}");
    master.answer(&name, Err(UnitError::Wrong(why)));
    std::ptr::null_mut()
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3FreeInstance(handle: Handle) {
    let _ = caught(|| {
        INSTANCES.remove(handle.addr());
        STATES.retain(|(owner, _)| *owner != handle.addr());
        Ok(())
    });
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetDebugLogging(
    handle: Handle,
    on: Boolean,
    n: usize,
    categories: *const Text,
) -> Status {
    with(handle, |instance| {
        // SAFETY: texts of the master.
        let categories =
            unsafe { slice(categories, n) }?.iter().map(|c| unsafe { text(*c) }.unwrap_or_default());
        instance.set_logging(on != 0, &categories.collect::<Vec<String>>())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3EnterInitializationMode(
    handle: Handle,
    _tolerance_defined: Boolean,
    _tolerance: f64,
    start: f64,
    stop_defined: Boolean,
    stop: f64,
) -> Status {
    with(handle, |i| i.enter_initialization(start, (stop_defined != 0).then_some(stop)))
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3ExitInitializationMode(handle: Handle) -> Status {
    with(handle, Instance::exit_initialization)
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3Terminate(handle: Handle) -> Status {
    with(handle, Instance::terminate)
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3Reset(handle: Handle) -> Status {
    with(handle, Instance::reset)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFloat64(
    handle: Handle,
    references: *const Reference,
    n: usize,
    values: *mut f64,
    n_values: usize,
) -> Status {
    with(handle, |instance| {
        // SAFETY: arrays of the master.
        let found = instance.get(unsafe { slice(references, n) }?, Kind::Float64, n_values)?;
        unsafe { write(values, &found) }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFloat64(
    handle: Handle,
    references: *const Reference,
    n: usize,
    values: *const f64,
    n_values: usize,
) -> Status {
    // SAFETY: arrays of the master.
    with(handle, |i| {
        i.set(unsafe { slice(references, n) }?, Kind::Float64, unsafe { slice(values, n_values) }?)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetBoolean(
    handle: Handle,
    references: *const Reference,
    n: usize,
    values: *mut Boolean,
    n_values: usize,
) -> Status {
    with(handle, |instance| {
        // SAFETY: arrays of the master.
        let found = instance.get(unsafe { slice(references, n) }?, Kind::Boolean, n_values)?;
        let found: Vec<Boolean> = found.iter().map(|v| u8::from(*v != 0.0)).collect();
        unsafe { write(values, &found) }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetBoolean(
    handle: Handle,
    references: *const Reference,
    n: usize,
    values: *const Boolean,
    n_values: usize,
) -> Status {
    with(handle, |instance| {
        // SAFETY: arrays of the master.
        let given = unsafe { slice(values, n_values) }?.iter().map(|v| f64::from(u8::from(*v != 0)));
        instance.set(unsafe { slice(references, n) }?, Kind::Boolean, &given.collect::<Vec<f64>>())
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetString(
    handle: Handle,
    references: *const Reference,
    n: usize,
    values: *mut Text,
    n_values: usize,
) -> Status {
    with_held(handle, |held| {
        // SAFETY: arrays of the master.
        let words = held.lock().words(unsafe { slice(references, n) }?, n_values)?;
        let texts: Vec<CString> = words.into_iter().map(|w| CString::new(w).unwrap_or_default()).collect();
        let pointers: Vec<Text> = texts.iter().map(|t| t.as_ptr()).collect();
        unsafe { write(values, &pointers) }?;
        *held.texts.lock().unwrap_or_else(PoisonError::into_inner) = texts;
        Ok(())
    })
}

/// Values of types that no variable has.
macro_rules! no_values {
    ($($name:ident: $value:ty),* $(,)?) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $name(handle: Handle, _: *const Reference, _: usize, _: $value, _: usize) -> Status {
            none(handle, stringify!($name))
        }
    )*};
}

no_values! {
    fmi3GetFloat32: *mut f32, fmi3SetFloat32: *const f32,
    fmi3GetInt8: *mut i8, fmi3SetInt8: *const i8,
    fmi3GetUInt8: *mut u8, fmi3SetUInt8: *const u8,
    fmi3GetInt16: *mut i16, fmi3SetInt16: *const i16,
    fmi3GetUInt16: *mut u16, fmi3SetUInt16: *const u16,
    fmi3GetInt32: *mut i32, fmi3SetInt32: *const i32,
    fmi3GetUInt32: *mut u32, fmi3SetUInt32: *const u32,
    fmi3GetInt64: *mut i64, fmi3SetInt64: *const i64,
    fmi3GetUInt64: *mut u64, fmi3SetUInt64: *const u64,
    fmi3SetString: *const Text,
}

/// Functions for what no unit of ours has, with their further parameters.
macro_rules! nothing_of_the_kind {
    ($($name:ident($($type:ty),*);)*) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $name(handle: Handle $(, _: $type)*) -> Status {
            none(handle, stringify!($name))
        }
    )*};
}

nothing_of_the_kind! {
    fmi3GetBinary(*const Reference, usize, *mut usize, *mut *const u8, usize);
    fmi3SetBinary(*const Reference, usize, *const usize, *const *const u8, usize);
    fmi3GetClock(*const Reference, usize, *mut Boolean);
    fmi3SetClock(*const Reference, usize, *const Boolean);
    fmi3GetNumberOfVariableDependencies(Reference, *mut usize);
    fmi3GetVariableDependencies(Reference, *mut usize, *mut Reference, *mut usize, *mut c_int, usize);
    fmi3GetDirectionalDerivative(*const Reference, usize, *const Reference, usize, *const f64, usize, *mut f64, usize);
    fmi3GetAdjointDerivative(*const Reference, usize, *const Reference, usize, *const f64, usize, *mut f64, usize);
    fmi3EnterConfigurationMode();
    fmi3ExitConfigurationMode();
    fmi3GetIntervalDecimal(*const Reference, usize, *mut f64, *mut c_int);
    fmi3GetIntervalFraction(*const Reference, usize, *mut u64, *mut u64, *mut c_int);
    fmi3GetShiftDecimal(*const Reference, usize, *mut f64);
    fmi3GetShiftFraction(*const Reference, usize, *mut u64, *mut u64);
    fmi3SetIntervalDecimal(*const Reference, usize, *const f64);
    fmi3SetIntervalFraction(*const Reference, usize, *const u64, *const u64);
    fmi3SetShiftDecimal(*const Reference, usize, *const f64);
    fmi3SetShiftFraction(*const Reference, usize, *const u64, *const u64);
    fmi3EnterEventMode();
    fmi3EvaluateDiscreteStates();
    fmi3UpdateDiscreteStates(*mut Boolean, *mut Boolean, *mut Boolean, *mut Boolean, *mut Boolean, *mut f64);
    fmi3EnterContinuousTimeMode();
    fmi3CompletedIntegratorStep(Boolean, *mut Boolean, *mut Boolean);
    fmi3SetTime(f64);
    fmi3SetContinuousStates(*const f64, usize);
    fmi3GetContinuousStateDerivatives(*mut f64, usize);
    fmi3GetEventIndicators(*mut f64, usize);
    fmi3GetContinuousStates(*mut f64, usize);
    fmi3GetNominalsOfContinuousStates(*mut f64, usize);
    fmi3GetNumberOfEventIndicators(*mut usize);
    fmi3GetNumberOfContinuousStates(*mut usize);
    fmi3EnterStepMode();
    fmi3GetOutputDerivatives(*const Reference, usize, *const i32, *mut f64, usize);
    fmi3ActivateModelPartition(Reference, f64);
}

fn state(handle: Handle) -> Result<Arc<SavedState>, UnitError> {
    let found = STATES.get(handle.addr()).map(|(_, state)| state);
    found.ok_or_else(|| UnitError::wrong("this is no state of this library, or it was freed"))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFMUState(handle: Handle, to: *mut Handle) -> Status {
    with(handle, |instance| {
        let saved = (handle.addr(), Arc::new(instance.save()?));
        // SAFETY: one pointer of the master, null or a state of before, which is overwritten.
        let before = unsafe { slice(to, 1) }?[0];
        if !STATES.replace(before.addr(), saved.clone()) {
            unsafe { write(to, &[std::ptr::without_provenance_mut(STATES.put(saved))]) }?;
        }
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetFMUState(handle: Handle, from: Handle) -> Status {
    with(handle, |instance| instance.restore(&*state(from)?))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeFMUState(handle: Handle, at: *mut Handle) -> Status {
    with(handle, |_| {
        if at.is_null() {
            return Ok(());
        }
        // SAFETY: one pointer of the master.
        let given = unsafe { slice(at, 1) }?[0];
        if !given.is_null() && STATES.remove(given.addr()).is_none() {
            return Err(UnitError::wrong("this is no state of this library, or it was freed"));
        }
        unsafe { write(at, &[std::ptr::null_mut()]) }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SerializedFMUStateSize(
    handle: Handle,
    from: Handle,
    size: *mut usize,
) -> Status {
    // SAFETY: one number of the master.
    with(handle, |_| unsafe { write(size, &[state(from)?.n_bytes()]) })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SerializeFMUState(
    handle: Handle,
    from: Handle,
    bytes: *mut u8,
    size: usize,
) -> Status {
    with(handle, |_| {
        let state = state(from)?.to_bytes();
        if state.len() != size {
            return Err(UnitError::Wrong(format!("room for {size} bytes, the state has {}", state.len())));
        }
        // SAFETY: an array of the master.
        unsafe { write(bytes, &state) }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DeserializeFMUState(
    handle: Handle,
    bytes: *const u8,
    size: usize,
    to: *mut Handle,
) -> Status {
    with(handle, |_| {
        // SAFETY: an array and a pointer of the master.
        let state = SavedState::of_bytes(unsafe { slice(bytes, size) }?)?;
        let kept = STATES.put((handle.addr(), Arc::new(state)));
        unsafe { write(to, &[std::ptr::without_provenance_mut(kept)]) }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DoStep(
    handle: Handle,
    from: f64,
    size: f64,
    _no_way_back: Boolean,
    event_needed: *mut Boolean,
    terminates: *mut Boolean,
    returns_early: *mut Boolean,
    last_time: *mut f64,
) -> Status {
    with_held(handle, |held| {
        let (mut end, mut is_early) = (held.lock().begin_step(from, size)?, false);
        let is_watched = held.update.is_some();
        // What is seen between counts for nothing where the step fails.
        let before = is_watched.then(|| held.lock().before_stops(end)).transpose()?.flatten();
        let reached = loop {
            let went = held.lock().go_on(end, is_watched);
            match went {
                Ok(Progress::Done(time)) => {
                    held.shown(time, false);
                    break Ok(time);
                }
                Ok(Progress::Between(time)) => match held.shown(time, true) {
                    None => {}
                    Some(wanted) if wanted > time && wanted < end => (end, is_early) = (wanted, true),
                    Some(wanted) if wanted >= end => {}
                    Some(_) => {
                        is_early = true;
                        break Ok(time);
                    }
                },
                Err(why) => break Err(why),
            }
        };
        let time = reached.as_ref().map_or(from, |time| *time);
        if let (Err(_), Some(before)) = (&reached, &before) {
            held.lock().restore(before)?;
        }
        // SAFETY: numbers of the master.
        unsafe {
            write(event_needed, &[0])?;
            write(terminates, &[0])?;
            write(returns_early, &[u8::from(is_early)])?;
            write(last_time, &[time])?;
        }
        reached.map(|_| ())
    })
}

impl Held {
    /// Lets the master look at the unit within a step; when it wants the step to end, where it does and may.
    fn shown(&self, time: f64, is_between: bool) -> Option<f64> {
        let update = self.update?;
        let may_return = is_between && self.lock().may_return_early();
        self.lock().show(true);
        let (mut wants, mut when) = (0, time);
        // SAFETY: the master's own function; it may call the getters of this instance, which is not locked.
        unsafe {
            let environment = self.master.environment as Handle;
            update(environment, time, 0, 1, 1, u8::from(may_return), &mut wants, &mut when);
        }
        self.lock().show(false);
        // A time that is none means now.
        (wants != 0 && may_return).then_some(if when > time { when } else { time })
    }
}
