//! Collects messages of the validation layers in a list, which tests assert to be empty.

use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex};

use ash::vk;

/// Collected warnings and errors of the validation layers, in order of arrival.
#[derive(Clone, Default)]
pub struct ValidationMessages(Arc<Mutex<Vec<String>>>);

impl ValidationMessages {
    /// Takes all messages since the last call.
    pub fn take(&self) -> Vec<String> {
        self.0.lock().map(|mut list| std::mem::take(&mut *list)).unwrap_or_default()
    }

    /// A create-info whose callback appends to this list. The list must outlive the messenger.
    pub(crate) fn messenger_info(&self) -> vk::DebugUtilsMessengerCreateInfoEXT<'_> {
        vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            .message_type(
                vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
            )
            .pfn_user_callback(Some(on_message))
            .user_data(Arc::as_ptr(&self.0).cast_mut().cast())
    }
}

/// Debug messenger callback: appends the message to the list.
unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: `user` is the pointer of `messenger_info`, alive as long as the messenger; Vulkan passes a valid `data`,
    // whose message is null or a C string.
    let (list, text) = unsafe {
        let list = &*user.cast::<Mutex<Vec<String>>>();
        let message = (*data).p_message;
        (list, if message.is_null() { String::new() } else { CStr::from_ptr(message).to_string_lossy().into_owned() })
    };
    if let Ok(mut list) = list.lock() {
        list.push(text);
    }
    vk::FALSE
}
