use genmanip_llm::CassetteMode;
use genmanip_task_writer::LlmSettings;

/// The settings shown in the guide parse as documented.
#[test]
fn the_settings_of_the_guide() {
    let guide = include_str!("../../../../docs/guides/language-models.md");
    let blocks: Vec<&str> = guide.split("```toml\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
    let read: Vec<LlmSettings> = blocks
        .iter()
        .map(|text| LlmSettings::from_toml(text).unwrap_or_else(|error| panic!("{error}\n{text}")))
        .collect();
    assert_eq!(read[0].server.api_key_env.as_deref(), Some("OPENAI_API_KEY"));
    assert_eq!(read[0].prices.len(), 1);
    assert_eq!(read[1].server.model, "qwen2.5-14b-instruct");
    assert_eq!((read[2].server.total_timeout_s, read[2].generation.sampling.offered), (900.0, 5));
    assert_eq!(read[3].cassettes.mode, CassetteMode::Record);
    assert_eq!(read.len(), 4);
}
